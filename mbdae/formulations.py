"""The base class of forms: a form is a set of equations in which a scene is integrated, such as GGL.

Stabilised index-2 form of Gear, Gupta and Leimkuhler.

Index-1 form: constraints on the level of accelerations, with Baumgarte's stabilisation.

Index-3 form: position constraints only.

Ordinary differential equations: scenes without constraints.

Makes the System, the equations that a solver integrates, of a prepared scene in a form such as GGL.

Forms by object, class or name. The names follow from the classes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar

from mbdae.deferred import classes_in
from mbdae.errors import OptionError
from mbdae.notation import counted
from mbdae.process import building
from mbdae.symbolic.derive import Derived
from mbdae.symbolic.law import Element
from mbdae.symbolic.outputs import Target, beside_velocity, correction, dynamics, kinematics, lowest, scaled, state_rows, velocity
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.acceleration_kernel import POSITION, VELOCITY, stabilised
from mbdae.system.assembled.assembly import Assembly
from mbdae.system.assembled.jacobian_entries import FormSpec
from mbdae.system.model.model import Model
from mbdae.system.model.numbering import Row
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.without_multipliers import WithoutMultipliers
from mbdae.values import array, flag, instance, number, option, plain, set_option, several, word

__all__ = ["GGL", "ODE", "Form", "Index1", "Index3", "default_form", "system_for"]


#: end of the error messages about a wrong value of the option `waves`: the valid values and their meaning
WAVES = "give True to have Radau IIA resolve elastic vibrations, False to let it step over them"


class Form(ABC):
    """Base of the forms. A form turns laws into equations and says which multipliers are unknowns.

    Whoever adds one derives a frozen dataclass from this class; nothing else knows it. Its duties:

    1. `label`, its name in tables, messages and stored results.
    2. The option `waves`, whether elastic vibrations are resolved; `__post_init__` checks it and its own options.
    3. `spec`: which outputs it takes of every law, the blocks of rows and of multipliers they make, the index of each kind of
       unknown. What drifts, how many unknowns there are and which solvers take the form follows from it.
    4. Where it depends on the solver, `for_index`: its variant for the highest index of unknowns that this integrates.
    5. Where it depends on the scene, `for_time` (options that follow from the characteristic time) and `refusal` (scenes that it
       cannot describe, with what to do).
    """

    label: ClassVar[str]
    waves: bool

    @abstractmethod
    def spec(self) -> FormSpec:
        """What the form prescribes for the assembly of a scene: its equations, the blocks of unknowns, their index and
        options."""

    def refusal(self, model: Model, rows: list[Row]) -> str | None:
        """Why this form cannot describe the scene, or None."""
        return None

    def for_index(self, highest: int) -> Form:
        """The variant of this form for a solver that can integrate unknowns up to the differentiation index `highest`."""
        return self

    def within(self, highest: int) -> bool:
        """Whether a solver that integrates unknowns up to the index `highest` (0: ordinary differential equations only) takes
        this form, in its variant for that solver."""
        spec = self.for_index(highest).spec()
        return max(spec.index.values()) <= highest if highest else not spec.multipliers

    def for_time(self, characteristic: float) -> Form:
        """This form with those options filled in that depend on the characteristic time (s) of a scene."""
        return self


def ggl_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """q' = H (u + G^T mu), M u' + G^T lambda = f, G u + g_t = 0, g = 0; g: constraints, G: their Jacobian, H: from u to q'."""
    if isinstance(d.law, Element):
        return [*kinematics(d), *dynamics(d)]
    return [*dynamics(d), *correction(d), *scaled(d, velocity(d)), *scaled(d, beside_velocity(d)), *state_rows(d)]


@dataclass(frozen=True)
class GGL(Form):
    """Constraints of positions and of velocities are both satisfied, so that neither drifts.

    C.W. Gear, B. Leimkuhler, G.K. Gupta, J. Comput. Appl. Math. 12-13 (1985) 77.
    algebraic: False makes the multipliers time derivatives of unknowns (lambda = Lambda', mu = M'), which lowers the index of
    the equations to 1. True makes them algebraic unknowns of index 2; in this variant alone Radau IIA can pass singular
    positions. None (default): True for solvers that take index 2, else False; `Scene.system` gives the equations of index 1.
    waves: Radau IIA resolves elastic vibrations instead of stepping over them.
    """

    algebraic: bool | None = None
    waves: bool = False
    label: ClassVar[str] = "GGL"

    def __post_init__(self) -> None:
        set_option(self, "algebraic", flag,
                   "give True (index 2), False (multipliers as derivatives), or None (the solver decides)")
        set_option(self, "waves", flag, WAVES)

    def for_index(self, highest: int) -> GGL:
        return replace(self, algebraic=highest >= 2) if self.algebraic is None else self

    def spec(self) -> FormSpec:
        k = 2 if self.algebraic else 1
        rows = {"q": "q", "u": "u", "s": "s", "gd": "lambda", "g": "mu"}
        index = {"q": 1, "v": 1, "s": 1, "lambda": k, "mu": k}
        return FormSpec(self.label, ggl_outputs, rows, ("lambda", "mu"), not self.algebraic, index, bool(self.algebraic),
                        self.waves)


#: default of Baumgarte's alpha times the characteristic time of the scene. With 1, constraint violations decay as fast as the
#: motion changes, so that the constraint rows are no stiffer than the motion. Measured with CVODE on five scenes: 3 takes up to
#: 2.5, 10 up to 4, 100 up to 12 times the evaluations of 1 without a smaller error; with 0 the constraints drift and the error is
#: 5 to 50 times as large (docs/accuracy.md)
RATE = 1.0
MULTIPLIERS = ("derivatives", "algebraic", "eliminated")


def index1_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """q' = H u, M u' + G^T lambda = f, G u' + gamma + 2 alpha (G u + g_t) + beta^2 g = 0; g: constraints, G: their Jacobian,
    d2g/dt2 = G u' + gamma."""
    if isinstance(d.law, Element):
        return [*kinematics(d), *dynamics(d)]
    return [*dynamics(d), *stabilised(d), *state_rows(d)]


@dataclass(frozen=True)
class Index1(Form):
    """Constraints differentiated twice: cheap steps, but only Baumgarte's terms keep positions and velocities of joints closed.

    J. Baumgarte, Comput. Methods Appl. Mech. Eng. 1 (1972) 1.

    baumgarte    alpha (1/s): an error of a joint decays like exp(-alpha t); or the pair (alpha, beta) of
                 G u' + gamma + 2 alpha (G u + g_t) + beta^2 g = 0. None: 1 over the characteristic time of the scene; a
                 fixed alpha is too weak for a fast scene and makes a slow one stiff. 0: no stabilisation
    multipliers  "derivatives": they are time derivatives of unknowns (for IDA, whose error test fails where multipliers are
                 unknowns themselves); "algebraic": they are unknowns (for Radau IIA); "eliminated": u' and lambda are solved
                 for at every state, which leaves y' = f(t, y) (for CVODE). None: as the solver needs it; `Scene.system` gives
                 "derivatives"
    waves        Radau IIA resolves elastic vibrations instead of stepping over them

    A run warns where its constraints are violated by more than the accuracy at the end.
    """

    baumgarte: float | Sequence[float] | None = None
    multipliers: str | None = None
    waves: bool = False
    label: ClassVar[str] = "Index1"

    def __post_init__(self) -> None:
        set_option(self, "baumgarte", _pair, f"give alpha >= 0 in 1/s, the pair (alpha, beta), or None for {RATE:g} over the "
                                             f"characteristic time of the scene")
        set_option(self, "multipliers", word, "or give None to have it follow from the solver", words=MULTIPLIERS)
        set_option(self, "waves", flag, WAVES)

    def for_index(self, highest: int) -> Index1:
        if self.multipliers is not None:
            return self
        return replace(self, multipliers="algebraic" if highest >= 2 else MULTIPLIERS[2 * (highest < 1)])

    def for_time(self, characteristic: float) -> Index1:
        if self.baumgarte is not None:
            return self
        made = copy(self)
        object.__setattr__(made, "baumgarte", _pair(RATE / characteristic))
        return made

    def spec(self) -> FormSpec:
        alpha, beta = _pair(self.baumgarte if self.baumgarte is not None else 0.0)
        dotted, algebraic = self.multipliers in (None, "derivatives"), self.multipliers == "algebraic"
        rows = {"q": "q", "u": "u", "s": "s", "gdd": "lambda"}
        index = {"q": 1, "v": 1, "s": 1, "lambda": 1}
        numbers, eliminated = {VELOCITY: 2 * alpha, POSITION: beta**2}, self.multipliers == "eliminated"
        return FormSpec(self.label, index1_outputs, rows, ("lambda",), dotted, index, algebraic, self.waves, numbers=numbers,
                        eliminated=eliminated)


def _pair(value: Any) -> tuple[float, float]:
    """alpha and beta, equal where one number is given."""
    if not several(value):
        return (number(value, least=0),) * 2
    alpha, beta = (number(entry, least=0) for entry in array(value, (2,)))
    return alpha, beta


def index3_outputs(d: Derived) -> list[tuple[Target, Expr]]:
    """q' = H u, M u' + G^T lambda = f, g = 0; g: constraints, G: their Jacobian, H: from u to q'; of rows of velocities
    G u + g_t = 0."""
    if isinstance(d.law, Element):
        return [*kinematics(d), *dynamics(d)]
    return [*dynamics(d), *scaled(d, lowest(d)), *state_rows(d)]


@dataclass(frozen=True)
class Index3(Form):
    """Equations of motion with the constraints on positions, not differentiated; for mbdae's own integrators (IDA refuses it).

    waves: elastic vibrations are resolved instead of stepped over."""

    waves: bool = False
    label: ClassVar[str] = "Index3"

    def __post_init__(self) -> None:
        set_option(self, "waves", flag, WAVES)

    def spec(self) -> FormSpec:
        rows = {"q": "q", "u": "u", "s": "s", "g": "lambda"}
        index = {"q": 1, "v": 2, "s": 1, "lambda": 3}
        return FormSpec(self.label, index3_outputs, rows, ("lambda",), False, index, True, self.waves)


@dataclass(frozen=True)
class ODE(Form):
    """q' = H u, M u' = f, for scenes without constraints. mixed: the stress resultants of beams are algebraic unknowns, which
    Radau IIA can integrate; waves: Radau IIA resolves elastic vibrations instead of stepping over them."""

    mixed: bool = False
    waves: bool = False
    label: ClassVar[str] = "ODE"

    def __post_init__(self) -> None:
        set_option(self, "mixed", flag, "give True to keep the stresses of beams as unknowns, False to leave them out")
        set_option(self, "waves", flag, WAVES)

    def for_index(self, highest: int) -> ODE:
        return replace(self, mixed=highest >= 2)

    def spec(self) -> FormSpec:
        index = {"q": 1, "v": 1, "s": 1}
        return FormSpec(self.label, index3_outputs, {"q": "q", "u": "u", "s": "s"}, (), False, index, self.mixed, self.waves)

    def refusal(self, model: Model, rows: list[Row]) -> str | None:
        if not rows:
            return None
        trees = "" if any(joint.recursive for joint in model.scene.joints) else ", or s.recursive() if its joints form a tree"
        return (f"form ODE needs a scene without constraints, this one has {counted(len(rows), 'constraint row')} (such as "
                f"{rows[0].name}): use mb.GGL(){trees}")


def default_form(prepared: Prepared, highest_index: int = 1) -> Form:
    """GGL (stabilised index 2); ODE where nothing is constrained; Index1 for a solver that takes ODEs only (highest_index 0)."""
    return (GGL() if highest_index else Index1()) if prepared.rows else ODE()


@building
def system_for(prepared: Prepared, form: Form | None = None, highest_index: int = 1,
               open: bool = False) -> SceneSystem:
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
    return SceneSystem(prepared, spec, assembly=Assembly(prepared.model, prepared.mechanics.rows, spec, None, moved))


def shared_system(prepared: Prepared, form: Form | None = None, highest_index: int = 1) -> SceneSystem:
    """`system_for`, made once of a prepared scene, for runs one after the other."""
    form = form if form is not None else default_form(prepared, highest_index)
    key = form.for_index(highest_index).for_time(prepared.time)
    if key not in prepared.kept:
        prepared.kept[key] = system_for(prepared, form, highest_index)
    return prepared.kept[key]  # type: ignore[no-any-return]


REMEDY = "give a form such as mb.GGL(), mb.Index3() or 'ggl', or None for the default of the scene"


def forms() -> tuple[type[Form], ...]:
    """The forms of the package: every class in its folder that derives from `Form`."""
    return classes_in("mbdae.formulations", Form)


@cache
def form_words() -> dict[str, Form]:
    """Word of every form, as a command line takes it -> the form with its defaults: "ggl", "index3", "index1", "ode"."""
    return {plain(made.__name__): made() for made in forms()}


def form_of(value: Any, name: str = "form", remedy: str = REMEDY) -> Form:
    """The form that an object, a class (the user's own too) or a name stands for; OptionError with the known names."""
    found: Form = value if isinstance(value, Form) else option(name, value, instance, remedy, base=Form, known=form_words())
    return found
