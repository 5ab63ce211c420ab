"""Solvers by object, class or name; the names are derived from the classes.

Measurement of the order of a method: how its error falls with its constant step.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cache
from math import lcm
from typing import Any

import numpy as np

from mbdae.deferred import classes_in, entered
from mbdae.errors import AccuracyWarning, ListsAttributes, OptionError, SolverError, naming_arguments
from mbdae.formulations import default_form, form_of, system_for
from mbdae.integrators.base import Solver, end_after
from mbdae.integrators.radau import RadauIIA
from mbdae.scene.scene import SceneData
from mbdae.system.base import Array, System
from mbdae.system.prepare import prepare
from mbdae.values import function, instance, option, optional, plain, sequence, shown, whole

REMEDY = "give a solver such as mb.IDA(), mb.RadauIIA(3) or 'radau3'"


def solvers(called: str = "") -> tuple[type[Solver], ...]:
    """The solvers of the package, every class in its folder that derives from `Solver`, and those that installed packages enter
    in the group "mbdae.solvers" of entry points. called: a word; others than those with such a name may be left out, so that
    they are not imported."""
    own = classes_in("mbdae.integrators", Solver, called)
    return own if called else (*own, *entered("mbdae.solvers", Solver).values())


@cache
def solver_words(called: str = "") -> dict[str, Solver]:
    """All solvers with default options, by their names on the command line: "ida", "radau", "radau2", "cvodebdf"."""
    found: dict[str, Solver] = {}
    for made in solvers(called):
        word = made.word or plain(made.__name__)
        for variant in made.variants():
            found.setdefault(word, made())
            found[plain(variant.label).replace(plain(made.__name__), word)] = variant
    return found


@cache
def _full_names(called: str) -> dict[str, Solver]:
    """All solvers by their labels without punctuation, in small letters: "radauiia3", "generalizedalpha"."""
    by_label = {plain(variant.label): variant for made in solvers(called) for variant in made.variants()}
    return {plain(made.__name__): made() for made in solvers(called)} | by_label


@cache
def _elsewhere() -> dict[str, list[str]]:
    """Names of methods in other programs, with the names of their counterparts among the solvers."""
    found: dict[str, list[str]] = {}
    for made in solvers():
        for name, own in vars(made).get("counterparts", {}).items():
            found.setdefault(name, []).append(f"'{own}'")
    return found


def solver_of(value: Any, name: str = "solver", remedy: str = REMEDY) -> Solver:
    """The solver that an object, a class (the user's own too) or a name stands for; OptionError with the known names."""
    if isinstance(value, Solver):  # the list of all would import them
        return value
    word = plain(value) if isinstance(value, str) else ""
    for called in (word, "") if word else ():  # the files that have the name alone, then all
        if meant := _full_names(called).get(word, solver_words(called).get(word)):
            return meant
    if own := _elsewhere().get(word):
        raise OptionError(f"{name} = {shown(value)} is a method of other programs; its counterpart here is {' or '.join(own)}")
    found: Solver = option(name, value, instance, remedy, base=Solver, known=solver_words())
    return found


STEPS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256)
PARTS = {"q": "positions", "v": "velocities", "s": "internal states", "y": "unknowns", "lambda": "multipliers"}
BEGIN = 0.25  #: errors in this fraction of the run, from its start, are not counted: multipliers may have a lower order there
#: an error (relative to the largest value) is usable where it is more than ABOVE times that of the reference and that of a run
#: that shows round-off (ROUGH), and less than SMALL
ABOVE, SMALL = 30.0, 0.1
ROUND_OFF = 1e-14  #: relative error that is assumed of the values of a closed solution (`exact`)
#: errors below this that rise with a shorter step are round-off; they and those of all shorter steps are not used
ROUGH = 1e-7
#: the order is that of the finest three consecutive runs with usable errors; there is none where the orders in the WINDOWS finest
#: such sets of three differ by more than AGREE and by more than the fraction PART of the order
WINDOWS = 3
AGREE, PART = 0.3, 0.1


@dataclass(frozen=True)
class Orders(ListsAttributes):
    """Observed orders of a method; print it for a table.

    orders  by kind of unknowns ("positions", "velocities", "multipliers" ...): a number, or None where none can be determined,
            with the reason in `why`
    steps   (k,) numbers of equal steps of the runs
    errors  (k,) by kind of unknowns: the largest error at the ends of steps in the last three quarters of a run, relative to the
            largest value there; nan where a run failed
    """

    label: str
    form: str
    steps: tuple[int, ...]
    errors: dict[str, Array]
    orders: dict[str, float | None]
    why: dict[str, str]

    def __str__(self) -> str:
        lines = ["".join([f"{'steps':>6}", *(f"{part:>18}{'order':>7}" for part in self.errors)])]
        slopes = {part: _slopes(self.steps, errors) for part, errors in self.errors.items()}
        for i, count in enumerate(self.steps):
            lines.append(f"{count:6d}" + "".join(f"{e[i]:18.2e}{slopes[part][i]:7.2f}" for part, e in self.errors.items()))
        told = [f"{part}: " + (self.why[part] if order is None else f"order {order:.2f}") for part, order in self.orders.items()]
        return "\n".join([f"{self.label}, {self.form}", *lines, *told])


def _slopes(steps: tuple[int, ...], errors: Array) -> Array:
    """Order (k,) that the error of every run shows compared with that of the coarser run before it; nan for the first."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.concatenate([[np.nan], -np.diff(np.log(errors)) / np.diff(np.log(steps))])


@naming_arguments
def measure_order(solver: Any, what: Any, t_end: float, form: Any = None, steps: Any = STEPS,
                  exact: Callable[[Array], Array] | None = None) -> Orders:
    """Orders of a method with constant steps, from runs of a scene or of other equations (`mb.DAE`) to t_end (s).

    solver: one with an option `step`, which is set here; form: of a scene, by default that of the solver. steps: rising numbers
    of equal steps. exact: times (k,) -> the first m unknowns (k, m); without it Radau IIA with 5 stages and many steps is the
    reference (3 stages for itself), trusted as far as both agree. OptionError where the solver has no constant step, or refuses
    the equations; SolverError where the reference fails.
    """
    method = solver_of(solver)
    if not any(f.name == "step" for f in fields(method)):  # type: ignore[arg-type]
        raise OptionError(f"solver = {shown(method)} has no constant step, so its error has no order in it: give one that has, "
                          f"such as mb.RadauIIA(3) or mb.HHT()")
    if not isinstance(what, SceneData | System):
        raise OptionError(f"what = {shown(what)} is neither a scene nor other equations: give a scene, or mb.DAE(...)")
    counts = tuple(option("steps", steps, sequence, "give three or more rising numbers of steps", each=whole, least=1))
    if len(counts) < 3 or not (np.diff(counts) > 0).all():
        raise OptionError(f"steps = {shown(steps)}: give three or more rising numbers of steps")
    optional("exact", exact, function, "give a function of times (k,), or None", takes="t")
    if form is not None and isinstance(what, System):
        raise OptionError(f"form = {shown(form)}: only scenes take a form; omit it for other equations")
    system: System
    full: System
    if isinstance(what, SceneData):
        prepared = prepare(what)
        own = form_of(form) if form is not None else default_form(prepared, method.highest_index)
        system, full = system_for(prepared, own, method.highest_index), system_for(prepared, own, RadauIIA.highest_index)
    else:
        system, full = what, what
    span = end_after(system.t0, t_end) - system.t0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AccuracyWarning)
        reference, floors = _reference(method, full, span, counts) if exact is None else _closed_form(exact, system)
        errors = [_errors(_with_steps(method, span, count), system, span, reference) for count in counts]
    parts = {part: np.array([e.get(part, np.nan) for e in errors]) for part in floors}
    found = {part: _order(_slopes(counts, e), e, floors[part]) for part, e in parts.items()}
    return Orders(method.label, system.label, counts, parts, {part: order for part, (order, _) in found.items()},
                  {part: text for part, (_, text) in found.items() if text})


Reference = Callable[[Array], dict[str, Array]]  #: function of times (k,) -> values (k, m) of each kind of unknowns


def _with_steps(solver: Solver, span: float, count: int) -> Solver:
    return replace(solver, step=span / count)  # type: ignore[type-var]


def _parts(system: System, y: Array) -> dict[str, Array]:
    """Values (k, m) of each kind of unknowns, by its name in PARTS; y (k, number of leading unknowns)."""
    kinds = np.array(system.kinds[: y.shape[1]])
    return {part: y[:, kinds == kind] for kind, part in PARTS.items() if (kinds == kind).any()}


def _closed_form(exact: Callable[[Array], Array], system: System) -> tuple[Reference, dict[str, float]]:
    def values(t: Array) -> dict[str, Array]:
        y = np.asarray(exact(t), dtype=float)
        if y.ndim != 2 or len(y) != len(t) or not 0 < y.shape[1] <= system.n:
            raise OptionError(f"exact = {shown(exact)} returns an array of shape {y.shape} for {len(t)} times: return shape "
                              f"({len(t)}, m), the first m unknowns at these times, m from 1 to {system.n}")
        return _parts(system, y)

    return values, dict.fromkeys(values(np.array([system.t0])), ROUND_OFF)


def _reference(solver: Solver, system: System, span: float, counts: tuple[int, ...]) -> tuple[Reference, dict[str, float]]:
    """Values by Radau IIA with many steps, and the difference from Radau IIA with another number of stages."""
    many = min(lcm(*counts), 4 * counts[-1])  # if small enough a common multiple, so that ends of steps coincide
    methods = sorted((RadauIIA(5), RadauIIA(3)), key=lambda method: method.label == solver.label)
    runs = [_with_steps(method, span, many).solve(system, system.t0 + span) for method in methods]
    t = runs[0].t[runs[0].t >= system.t0 + BEGIN * span]
    apart = _distances(_parts(system, runs[1](t)), _parts(system, runs[0](t)))
    return lambda at: _parts(system, runs[0](at)), {part: max(apart[part], ROUND_OFF) for part in apart}


def _distances(a: dict[str, Array], b: dict[str, Array]) -> dict[str, float]:
    """Largest difference of each kind of unknowns that a and b have, relative to its largest value in b."""
    found = {}
    for part in a.keys() & b.keys():
        x, y = a[part][:, : b[part].shape[1]], b[part]
        found[part] = float(np.abs(x - y).max() / (np.abs(y).max() or 1.0))
    return found


def _errors(solver: Solver, system: System, span: float, reference: Reference) -> dict[str, float]:
    """Error of each kind of unknowns in a run of the solver, relative to its largest value; empty where the run fails."""
    try:
        run = solver.solve(system, system.t0 + span)
    except SolverError:
        return {}
    late = run.t >= system.t0 + BEGIN * span * (1 - 1e-9)
    return _distances(_parts(system, run.y[late]), reference(run.t[late]))


def _order(slopes: Array, errors: Array, floor: float) -> tuple[float | None, str]:
    """The order from `slopes` (k,), as of `_slopes`, and `errors` (k,) of all runs, or None and the reason. floor: relative error
    of the reference."""
    if np.isnan(errors).all():
        return None, "every run failed, or the equations have no such unknowns in this form"
    if ABOVE * floor >= SMALL:
        return None, (f"no order to be seen: the reference itself is uncertain by {floor:.0e} of the largest value; give "
                      "larger numbers in steps=, or exact=")
    rises = np.flatnonzero((errors[1:] >= errors[:-1]) & (errors[1:] < ROUGH))
    last = int(rises[0]) if len(rises) else len(errors)
    floor = max(floor, float(errors[last + 1])) if len(rises) else floor
    shows = (errors > ABOVE * floor) & (errors < SMALL) & (np.arange(len(errors)) <= last)
    windows = np.flatnonzero(shows[:-2] & shows[1:-1] & shows[2:])[-WINDOWS:]
    if not len(windows):
        return None, ("no order to be seen: fewer than three neighbouring runs have errors (over the largest value) from "
                      f"{ABOVE * floor:.0e}, below which lie those of the reference and of round-off, to {SMALL:g}; give "
                      "more numbers in steps=, larger ones where errors are above it, smaller ones where below")
    found = slopes[windows[0] + 1 : windows[-1] + 3]
    order = float(found[-2:].mean())
    if not np.ptp(found) <= max(AGREE, PART * abs(order)):
        return None, (f"no order to be seen: the order goes from {found.min():.2f} to {found.max():.2f} between neighbouring "
                      "runs, as where the equations have kinks or the steps are too long; give larger numbers in steps=")
    return order, ""
