"""Forms: the sets of equations in which a scene can be integrated (GGL, index 3, index 1, ODE)."""

from mbdae.formulations.base import Form
from mbdae.formulations.build import default_form, system_for
from mbdae.formulations.ggl import GGL
from mbdae.formulations.index1 import Index1
from mbdae.formulations.index3 import Index3
from mbdae.formulations.ode import ODE

__all__ = ["GGL", "ODE", "Form", "Index1", "Index3", "default_form", "system_for"]
