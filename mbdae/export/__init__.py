"""`mbdae.export`: equations that leave mbdae."""
from mbdae.export.scene import scene_program
