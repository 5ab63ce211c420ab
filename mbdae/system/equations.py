"""The equations of a prepared scene, as a form wants them."""

from __future__ import annotations

from mbdae.system.assembled.form_spec import FormSpec
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.without_multipliers import WithoutMultipliers


def make_system(prepared: Prepared, spec: FormSpec, sparse: bool | None = None) -> SceneSystem:
    """The System of a prepared scene in a form."""
    kind = WithoutMultipliers if spec.eliminated and prepared.rows else SceneSystem
    return kind(prepared, spec, sparse)
