"""Makes the System, the equations that a solver integrates, of a prepared scene in a form such as GGL."""

from __future__ import annotations

from mbdae.errors import OptionError
from mbdae.formulations.base import Form
from mbdae.formulations.ggl import GGL
from mbdae.formulations.index1 import Index1
from mbdae.formulations.ode import ODE
from mbdae.memory import building
from mbdae.system.assembled.ordered_assembly import assembly_of
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.without_multipliers import WithoutMultipliers


def default_form(prepared: Prepared, highest_index: int = 1) -> Form:
    """GGL (stabilised index 2); ODE where nothing is constrained; Index1 for a solver that takes ODEs only (highest_index 0)."""
    return (GGL() if highest_index else Index1()) if prepared.rows else ODE()


@building
def system_for(prepared: Prepared, form: Form | None = None, highest_index: int = 1,
               open: bool = False) -> SceneSystem:  # fmt: skip
    """The System of a prepared scene, in the variant of the form for a solver that integrates unknowns up to `highest_index`.

    form: None chooses `default_form`. open: numbers of the laws can be varied between runs (`MovedBodies.opened`); it has no
    effect where the multipliers are eliminated."""
    form = form if form is not None else default_form(prepared, highest_index)
    refusal = form.refusal(prepared.model, prepared.rows)
    if refusal:
        raise OptionError(f"scene '{prepared.model.scene.name}': {refusal}")
    spec = form.for_index(highest_index).for_time(prepared.time).spec()
    if spec.eliminated and prepared.rows:
        return WithoutMultipliers(prepared, spec)
    if not open:
        return SceneSystem(prepared, spec)
    moved = prepared.all_bodies.moved.opened(prepared.model)
    return SceneSystem(prepared, spec, assembly=assembly_of(moved)(prepared.model, prepared.mechanics.rows, spec, None, moved))
