"""Conditions on sensors, "J.angle > 1.0", as text or symbols: the functions that change their sign, and how they are joined.

Steps of a run with a large defect, integrated again with steps short enough to resolve what acts for a short time.
"""

from __future__ import annotations

import re
import time
import warnings
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import symengine as se
from numpy.typing import NDArray

from mbdae.deferred import distinct
from mbdae.errors import AccuracyWarning, OptionError, SolverError, WallClockError
from mbdae.formulations import Form, system_for
from mbdae.inputs import tables, text, timed
from mbdae.inputs.sensed import paths, symbol_name
from mbdae.integrators.base import Solver
from mbdae.integrators.radau import RadauIIA
from mbdae.integrators.solution import Solution
from mbdae.results.accuracy import Accuracy
from mbdae.run import pieces as signals
from mbdae.run.defect import Defect, Suspect, apart
from mbdae.run.estimate import Controlled
from mbdae.scene.control import stated_values
from mbdae.scene.sensed import spelled
from mbdae.symbolic.rebuild import CONDITIONS, is_condition
from mbdae.symbolic.vectors import Expr
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.system.scene_system import SceneSystem
from mbdae.system.start import Start
from mbdae.values import BadValueError, shown

EXAMPLE = "write one such as 'J.angle > 0.5', 'b.position[1] == 0', or sympy.And(...) of such"
_NAME = re.compile(r'sensor\("(?:[^"\\]|\\.)*"\)|(?<![\w.])[A-Za-z_]\w*(?:\.at\([^()]*\)|\.[A-Za-z_]\w*)*(?:\[[\d\s,]*\])*')
_SENSOR = re.compile(r'sensor\("((?:[^"\\]|\\.)*)"\)')
_NORM = re.compile(r"\b(?:norm|magnitude)\(\s*([A-Za-z_]\w*(?:\.at\([^()]*\)|\.[A-Za-z_]\w*)+)\s*\)")
Truth = NDArray[np.bool_]


@dataclass(frozen=True)
class Condition:
    """A condition on sensors, made of k comparisons of functions g with 0.

    name: its text; functions (k,): g of every comparison; equations (k,): whether it is g = 0, else it is g > 0; meeting (k,):
    whether it holds also where g = 0; tree: how comparisons are joined: the index of one, or ("and", "or" or "not", list of
    trees)."""

    name: str
    functions: tuple[Expr, ...]
    equations: tuple[bool, ...]
    meeting: tuple[bool, ...]
    tree: Any

    @property
    def is_equation(self) -> bool:
        """Whether the condition is a single equation."""
        return len(self.functions) == 1 and self.equations[0]

    def holds(self, atoms: Truth) -> bool:
        """Whether the condition holds; atoms (k,): whether each of its comparisons holds."""
        return _joined(self.tree, atoms)


def _joined(tree: Any, atoms: Truth) -> bool:
    if isinstance(tree, int):
        return bool(atoms[tree])
    kind, parts = tree
    found = [_joined(part, atoms) for part in parts]
    return all(found) if kind == "and" else any(found) if kind == "or" else not found[0]


def conditions(scene: Any, option: str, given: Any) -> list[Condition]:
    """The conditions `given` for an option (one or a list), which is named in messages; OptionError where one is no condition or
    reads an unknown sensor."""
    if given is None:
        return []
    if not isinstance(given, list | tuple):
        return [_read(scene, f"{option} = {shown(given)}", given)]
    head = f"{option} = {shown(given)}: {option}"
    return [_read(scene, f"{head}[{i}] = {shown(one)}", one) for i, one in enumerate(given)]


def ends_of_curves(scene: Any) -> list[Condition]:
    """Conditions under which a curve with outside="error", of a law or signal of a scene, is left; their names say which."""
    found = []
    for kind, item, value in stated_values(scene.connections, scene.signals):
        for table, x in timed.curves(value) if paths(value) else ():
            if table.outside == "error":
                low, high = float(table.t[0]), float(table.t[-1])
                at = signals.in_sensors(scene, x)
                over = _SENSOR.sub(lambda found: found[1], tables.readable(str(x)))
                name = f"{kind} '{item}' reads its curve over {over} beyond the points from {low:.6g} to {high:.6g}"
                found.append(Condition(name, (low - at, at - high), (False, False), (False, False), ("or", [0, 1])))
    return list({one.name: one for one in found}.values())


def _read(scene: Any, option_and_value: str, given: Any) -> Condition:
    """The condition `given`; option_and_value: with which messages begin."""
    try:
        e = _condition_of(scene, given)
        name = given if isinstance(given, str) else str(given)
        made = _Atoms()
        sides = _sides(scene, given)
        tree = made.tree(e) if sides is None else made.equation(*sides)
        for path in sorted({path for g in made.functions for path in paths(g)}):
            signals.check(scene, path)
    except (BadValueError, ValueError) as what_is_wrong:
        raise OptionError(f"{option_and_value}: {what_is_wrong}") from None
    functions = tuple(signals.in_sensors(scene, g) for g in made.functions)
    return Condition(name, functions, tuple(made.equations), tuple(made.meeting), tree)


def _condition_of(scene: Any, given: Any) -> Expr:
    """A condition as an expression of symengine."""
    if isinstance(given, bool | np.bool_):
        raise BadValueError(f"{given} is no condition (== of symbols is Python's own, which is {given} at once); write an "
                            f"equation as text, 'J.angle == 0', or as sympy.Eq(...)")
    if isinstance(given, str):
        e = text.whole(_with_symbols(scene, given))
    else:
        try:
            e = se.sympify(given)
        except Exception:  # SymPy and symengine raise errors of many types
            e = None
    if e is None or not is_condition(e):
        raise BadValueError(f"it is no comparison, nor And, Or or Not of comparisons; {EXAMPLE}")
    if e in (se.true, se.false):
        raise BadValueError(f"it does not depend on the motion or on time; {EXAMPLE}")
    return e


def _sides(scene: Any, given: Any) -> tuple[Any, Any] | None:
    """Left and right side of an equation in the order in which the user stated them, since symengine may exchange them; None
    where the condition is not a single equation."""
    if isinstance(given, str):
        try:
            left, right = (text.read(_with_symbols(scene, part)) for part in given.split("=="))
        except ValueError:  # the text is not of the form left == right
            return None
        return left, right
    return (given.lhs, given.rhs) if type(given).__name__ == "Equality" and hasattr(given, "lhs") else None


def _with_symbols(scene: Any, given: str) -> str:
    """The text with symbols of sensors in place of their paths."""
    known = {one.name for one in scene.signals}
    given, names = spelled(scene, given)
    given = _NORM.sub(lambda match: f"sqrt({' + '.join(f'{match[1]}[{i}]**2' for i in range(3))})", given)

    def name(match: re.Match[str]) -> str:
        head, dot, rest = match[0].partition(".")
        found = names.get(head, head) + dot + rest if not head.startswith("sensor(") else match[0]
        called = given[match.end() :].lstrip().startswith("(")
        is_path = "." in found or found in known
        return symbol_name(found) if is_path and not called and not found.startswith("sensor(") else found

    return _NAME.sub(name, given)


class _Atoms:
    """The comparisons of one condition, collected while it is read: functions, equations and meeting as in `Condition`."""

    def __init__(self) -> None:
        self.functions: list[Expr] = []
        self.equations: list[bool] = []
        self.meeting: list[bool] = []

    def tree(self, e: Expr) -> Any:
        """The tree of a condition as in `Condition`."""
        kind = type(e).__name__
        if kind in ("And", "Or", "Not"):
            return kind.lower(), [self.tree(part) for part in e.args]
        if kind not in CONDITIONS or kind == "Xor" or len(e.args) != 2:
            raise BadValueError(f"it contains {e}, which is no comparison; {EXAMPLE}")
        less, more = e.args
        if kind == "Unequality":
            return "not", [self._atom(more - less, True)]
        return self._atom(more - less, kind == "Equality", kind == "LessThan")  # symengine stores a > b as b < a

    def equation(self, left: Any, right: Any) -> int:
        """Add the equation left = right, whose function left - right rises where the left side does; returns its index."""
        return self._atom(left - right, True)

    def _atom(self, g: Expr, equation: bool, meeting: bool = True) -> int:
        self.functions.append(se.sympify(timed.expression(g, sensors=True)))
        self.equations.append(equation)
        self.meeting.append(equation or meeting)
        if not self.functions[-1].free_symbols:
            raise BadValueError(f"it does not depend on the motion or on time; {EXAMPLE}")
        return len(self.functions) - 1


FINER = 10.0  #: ratio of the accuracy of the run to that of the fine run, unless round-off forbids the latter
#: largest number of residual evaluations of the fine run from one point at which it stops to the next; where it needs more, the
#: effect estimated from the defect is taken instead
BUDGET = 3000
#: number of equally spaced times, from one point at which the fine run stops to the next, at which the run and the fine run are
#: compared, besides the steps of the fine run
BETWEEN = 8
MOST = 5  #: largest number of suspect steps of a run that are integrated again
SHORTER = 0.8  #: ratio of the step proposed in the warning to the longest one that would resolve the short event
WARNED = 3.0  #: a warning is given where the motions differ by more than this many times what is allowed in the step
UNCONTROLLED = 1e-6  #: accuracy assumed for runs without a tolerance (constant steps) for which no accuracy was asked


class FineRun:
    """Integrates steps of a run again, with Radau IIA to a tenth of the allowed difference."""

    def __init__(self, prepared: Prepared, form: Form, run: Solution, accuracy: float) -> None:
        self.prepared, self.form, self.run = prepared, form, run
        method = RadauIIA(3)
        wanted = accuracy / FINER * method.factor(form.label)
        self.solver = RadauIIA(3, rtol=max(wanted, 10 * method.tightest.get(form.label, method.tightest[""])))

    def difference(self, suspect: Suspect) -> float:
        """Largest distance between the run and a fine run over one step. The fine run starts from the state at the begin of the
        step and stops at every point with a large defect and at its neighbours. Where it fails, the effect of the defect is
        returned."""
        run, i, worst = self.run, suspect.step, 0.0
        system = self._system(float(run.t[i]), run.y[i])
        first = float(np.min(np.diff(np.r_[run.t[i], suspect.times, run.t[i + 1]]))) / 4
        for stop in self._stops(suspect):
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", AccuracyWarning)
                    part = self.solver.solve(system, stop, max_residuals=BUDGET, h0=min(first, stop - system.t0))
            except WallClockError:
                raise
            except SolverError:
                return suspect.effect
            times = distinct(np.r_[np.linspace(system.t0, stop, BETWEEN), part.t])
            motions = (self.prepared.states(times, solution(times))[:2] for solution in (part, run))
            worst = max(worst, float(np.max(apart(self.prepared, run, *motions))))
            system = system.starting(stop, part.y[-1], part.yp[-1])
        return worst

    def _system(self, t: float, y: Array) -> SceneSystem:
        """The equations that start at the time t (s) with the state y (n,) of the run, and with consistent accelerations and
        multipliers."""
        p, at = self.prepared, np.array([t])
        q, u, s = p.states(at, y[None])
        a, multipliers = p.mechanics.accelerations(at, q, u, s)
        start = Start(t, q[0], u[0], s[0], a[0], multipliers[0])
        system = system_for(replace(p, start=start), self.form, self.solver.highest_index)
        return system.sampling(None)  # without sampling instants, since sampled controllers hold their outputs inside a step

    def _stops(self, suspect: Suspect) -> Array:
        """Times (s) at which the fine run stops: points with a large defect, their neighbours, the end of the step."""
        large = suspect.large | np.append(suspect.large[1:], False) | np.append(False, suspect.large[:-1])
        return np.append(suspect.times[large], self.run.t[suspect.step + 1])



@dataclass(frozen=True)
class Contradiction:
    """A short event that a step missed: it acts from about `begin` to `end` (s) inside the step of length `step` (s). equation:
    name of the equation with the largest defect; difference: of the motion, as `motion_distance`; longest: longest step (s) that
    would resolve the event."""

    begin: float
    end: float
    step: float
    equation: str
    difference: float
    longest: float

    @classmethod
    def of(cls, run: Solution, suspect: Suspect, difference: float) -> Self:
        """The contradiction in a suspect step; difference: that of the motion from the fine run."""
        times, step = suspect.times[suspect.large], float(run.t[suspect.step + 1] - run.t[suspect.step])
        begin, end = float(times[0]), float(times[-1])
        return cls(begin, end, step, suspect.equation, difference, (end - begin + step / len(suspect.times)) / 2)


@dataclass(frozen=True)
class Rechecked:
    """Contradictions between the equations of motion and a run, worst first; suspects: number of suspicious steps; cpu_s: CPU
    time of the check, s."""

    contradictions: tuple[Contradiction, ...] = ()
    suspects: int = 0
    cpu_s: float = 0.0
    allowed: float = 0.0  #: largest difference that causes no warning

    @classmethod
    def again(cls, stored: dict[str, Any]) -> Self:
        """The object made from its stored plain data."""
        return cls(**stored | {"contradictions": tuple(Contradiction(**c) for c in stored["contradictions"])})

    def within(self, known: Accuracy) -> Accuracy:
        """The accuracy with the largest contradiction included in its estimate."""
        if not self.contradictions or known.estimated is None:
            return known
        return replace(known, estimated=max(known.estimated, self.contradictions[0].difference))

    @property
    def notes(self) -> list[str]:
        """The warning, if any: the worst contradiction, the times of the others, and what to do."""
        if not self.contradictions:
            return []
        c, *others = self.contradictions
        also = "; the same holds at t = " + ", ".join(f"{(o.begin + o.end) / 2:.6g}" for o in others) + " s" if others else ""
        if self.suspects > MOST:
            also += f" ({self.suspects} steps are suspect, of which {MOST} were integrated again)"
        return [f"from about t = {c.begin:.6g} to {c.end:.6g} s {c.equation} is not satisfied by the run, whose step of "
                f"{c.step:.3g} s was not evaluated there: with short steps the motion differs by {c.difference:.1e} (allowed "
                f"{self.allowed:.0e}){also}. Something acts there for a short time: take steps below {c.longest:.2g} s, as with "
                f"mb.RadauIIA(3, step={SHORTER * c.longest:.2g}), or end a run at t = {(c.begin + c.end) / 2:.6g} s and continue "
                f"it with start="]


def rechecked(prepared: Prepared, form: Form, system: SceneSystem, run: Controlled, asked: float | None) -> Rechecked:
    """Short events that a run missed because its solver did not evaluate the equations there; system: the equations it solved;
    asked: the accuracy, None where none was asked."""
    begin, solution, solver = time.process_time(), run.solution, run.solver
    if len(solution.t) < 2:
        return Rechecked()
    allowed = asked or _expected(solver)
    suspects = Defect(prepared, system, solution, rough=solver.fixed).suspects(allowed)
    fine = FineRun(prepared, form, solution, allowed)
    found = [Contradiction.of(solution, suspect, difference) for suspect in suspects[:MOST]
             if (difference := fine.difference(suspect)) > WARNED * suspect.allowed]
    found.sort(key=lambda c: -c.difference)
    return Rechecked(tuple(found), len(suspects), time.process_time() - begin, WARNED * allowed)


def _expected(solver: Solver) -> float:
    """The accuracy expected of a tolerance; UNCONTROLLED for constant steps."""
    if not solver.rtol:
        return UNCONTROLLED
    return max(10.0 * solver.rtol, solver.at_best or 0.0)
