"""A scene as a function of some of its numbers: values of sensors, and the derivatives of any weighted sum of them, as torch, jax
and SciPy ask for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from textwrap import fill
from typing import Any

import numpy as np

from mbdae.derivatives import Bound, Objective, names_of
from mbdae.errors import ListsAttributes, OptionError, naming_arguments
from mbdae.integrators.base import end_after, output_times
from mbdae.notation import counted
from mbdae.results.accuracy import plausible
from mbdae.results.quantities import Quantity, named, unit_of
from mbdae.results.reads import own_of
from mbdae.results.result import Result
from mbdae.run.checkpoint import versions
from mbdae.scene.scene import SceneData
from mbdae.show.plots import new_figure, style, written
from mbdae.study.statements import changed, stated_value
from mbdae.system.base import Array
from mbdae.values import array, number, option, sequence, shown, text


def varied(scene: SceneData, names: Sequence[str], values: Sequence[float], t_end: float) -> SceneData:
    """The scene with these values of its numbers; the end of the run stays."""
    for name, value in zip(names, values, strict=True):
        scene, _ = changed(scene, name, float(value), t_end)
    return scene


def identity_of(scene: SceneData) -> dict[str, Any]:
    """What a scene is known by in files that are resumed, as plain data."""
    return {"name": scene.name, "gravity": scene.gravity.tolist(), "statements": scene.statements, "own": own_of(scene),
            "versions": versions()}


def stated_values(scene: SceneData, names: Sequence[str], t_end: float) -> Array:
    """The values (k,) that a scene states of its numbers."""
    return np.array([stated_value(scene, name, t_end) for name in names])


class SceneFunction(ListsAttributes):
    """A scene as a function of some of its numbers, p (k,): values of quantities at the end of a run, (quantities,), or at times,
    (times, quantities).

    names: of the numbers; start (k,): their values in the scene; at: the times, s. After a call, `result` is the run, None where
    it failed."""

    def __init__(self, scene: SceneData, names: Sequence[str], of: Sequence[Quantity], t_end: float, times: Array | None,
                 accuracy: float) -> None:
        self.scene, self.names, self.of, self.t_end, self.accuracy = scene, tuple(names), tuple(of), t_end, accuracy
        self.times, self._last = times, times is None
        self.at = np.array([t_end]) if times is None else times
        self.start = stated_values(scene, names, t_end)
        self.result: Result | None = None
        self._p = np.zeros(0)  # the numbers of the last call

    def __call__(self, p: Any) -> Array:
        """Run the scene with the numbers p (k,); values (quantities,) or (times, quantities)."""
        self.result, self._p = None, np.zeros(0)  # where the run fails there are no derivatives, and not those of the run before
        p = option("p", p, array, f"give {len(self.names)} numbers, in the order {', '.join(self.names)}")
        if p.shape != (len(self.names),):
            raise OptionError(f"p has the shape {p.shape}: give {len(self.names)} numbers, in the order {', '.join(self.names)}")
        made: Any = varied(self.scene, self.names, p.tolist(), self.t_end)
        result = made.simulate(self.t_end, self.accuracy, outputs=self.at)
        values = self._shaped(_columns(result, self.of))
        self.result, self._p = result, p.copy()
        return values

    def pullback(self, weights: Any, p: Any = None) -> Array:
        """Derivatives (k,) by the numbers of the sum of weights times values; weights: of the shape of the values. p: as of
        `jacobian`. Their estimated errors (k,) are then in `pullback_errors`."""
        given = option("weights", weights, array, "give numbers of the shape of the values")
        shape = self._shaped(np.zeros((len(self.at), len(self.of)))).shape
        if given.shape != shape:
            raise OptionError(f"weights have the shape {given.shape}: give the shape of the values, {shape}")
        w = given.reshape(-1, len(self.of))

        def summed(r: Result) -> Array:
            return np.asarray(np.sum(_columns(r, self.of) * w[np.searchsorted(self.at, r.t).clip(0, len(w) - 1)], axis=1))

        found = self._run(p).gradient(_Weighted(summed, "weighted sum", times=self.at), to=list(self.names))
        self.pullback_errors = np.array([found[name].error for name in self.names])
        return np.array([found[name].value for name in self.names])

    @property
    def errors(self) -> Array:
        """Estimated largest errors (quantities,) of the values of the last call; nan where the run does not know them."""
        return np.array([np.nan if (error := self._run().error(q)) is None else error for q in self.of])

    def jacobian(self, p: Any = None) -> Array:
        """Derivatives (quantities, k) or (times, quantities, k) of the values. p (k,): the numbers, where these may not be those
        of the last call; the scene is run again where they are others. Their estimated largest errors (quantities, k) are then in
        `jacobian_errors`."""
        found = self._run(p).sensitivity(*self.of, to=list(self.names))
        by = [np.stack([np.asarray(found[q, name].value) for name in self.names], axis=-1) for q in self.of]
        self.jacobian_errors = np.array([[found[q, name].error for name in self.names] for q in self.of])
        return self._shaped(np.stack(by, axis=1))

    def _run(self, p: Any = None) -> Result:
        if p is not None and not np.array_equal(p, self._p):
            self(p)
        if self.result is None:
            raise OptionError("derivatives are those of the last call, and none gave values: call the function with numbers "
                              "first, or give them here, p=")
        return self.result

    def _shaped(self, values: Array) -> Array:
        return values[-1] if self._last else values


def _columns(r: Result, of: Sequence[Quantity]) -> Array:
    """Values (times, quantities); OptionError for a quantity with components."""
    columns = [r.value(q) for q in of]
    for q, values in zip(of, columns, strict=True):
        if values.ndim > 1:
            raise OptionError(f"{shown(q)} has components: name one, as in '{q}[0]'")
    return np.stack(columns, axis=1)


@dataclass(frozen=True)
class _Weighted(Objective):
    """The sum of a quantity over some times (s)."""

    times: Any = ()

    def points(self, run: Result) -> tuple[Array, Array]:
        """Times (k,) and weights (k,)."""
        return self.times, np.ones(len(self.times))


@naming_arguments
def function(scene: Any, t_end: float, of: Any, to: Any, outputs: Any = None, accuracy: float = 1e-6) -> SceneFunction:
    """A scene as a function of numbers in it, with derivatives, for torch, jax, SciPy and others.

    of: quantities without components, as in `Result.value`; to: names of numbers, as in `Result.gradient`; outputs: times (s), or
    their number, at which values are wanted, default the end of the run. f(p) returns the values, f.pullback(weights) the
    derivatives of their weighted sum, f.jacobian() all derivatives, of the last call or of the numbers given to them, p=."""
    scene = option("scene", scene, scene_given, "give a mb.Scene")
    names, end = names_of(to), end_after(0.0, t_end)
    of = [of] if isinstance(of, str) or callable(of) else list(of) if isinstance(of, list | tuple) else []
    if not of or not all(isinstance(q, str) or callable(q) for q in of):
        raise OptionError("of: give one or more quantities, such as ['D.angle'], each a sensor, an expression or a function")
    times = None if outputs is None else output_times(0.0, end, outputs)
    return SceneFunction(scene, names, of, end, times, plausible(accuracy))


def scene_given(value: Any) -> SceneData:
    """The scene that a user gave; OptionError for anything else."""
    if not isinstance(value, SceneData):
        raise OptionError(f"scene = {shown(value)}: give a mb.Scene")
    return value


# -- the mass of bodies


class Mass:
    """The mass of bodies of a scene, kg, as what `mb.design` makes least, or bounds."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = tuple(names)

    def of(self, scene: SceneData) -> float:
        """The mass of the bodies in a scene, kg; OptionError for a name of none."""
        bodies = {body.name: body.mass for body in scene.bodies}
        for name in self.names:
            if bodies.get(name) is None:
                raise OptionError(f"mass: there is no body '{name}' with a mass; there are {', '.join(bodies)}")
        return float(sum(bodies[name] for name in self.names))

    def __le__(self, limit: float) -> Bound:
        return Bound(self, 1.0, number(limit))

    def __ge__(self, limit: float) -> Bound:
        return Bound(self, -1.0, number(limit))

    def __str__(self) -> str:
        return f"mass of {', '.join(self.names)}"


def mass(*bodies: str) -> Mass:
    """The mass of bodies together, kg: what `mb.design` makes least, or bounds."""
    names = option("bodies", bodies, sequence, "name one body or more, such as mb.mass('crank')", each=text)
    if not names:
        raise OptionError("mass: name one body or more, such as mb.mass('crank')")
    return Mass(names)


# -- bounds, and the maxima of largest values

#: a bound holds where it is passed by less than this share of it (or of its value at the start, of a bound of 0); it is active
#: where it is that near
HELD = 1e-4


@dataclass(frozen=True)
class Held:
    """A bound at the design that was found. value: of what is bounded; error: its estimated error, None where it is exact or not
    known; active: whether the bound decides."""

    bound: Bound
    value: float
    error: float | None
    active: bool

    @property
    def kept(self) -> bool:
        """Whether it is kept, but for a ten-thousandth."""
        return self.bound.sign * (self.value - self.bound.limit) <= HELD * (abs(self.bound.limit) or 1.0)

    def __str__(self) -> str:
        word = "kept" if self.kept else "not kept"
        error = "" if self.error is None else f" +- {self.error:.1e}"
        return f"{self.bound}: {self.value:.6g}{error}, {word}{', decides' if self.active and self.kept else ''}"


def peak_slopes(run: Result, quantity: Any, times: Array, names: Sequence[str]) -> Array:
    """(2, m, k) derivatives of a quantity, or of the length of a vector, at times (m,) by the numbers, and their errors."""
    at, place = np.unique(times, return_inverse=True)
    r = run(at)
    values, found = np.asarray(r.value(quantity)), r.sensitivity(quantity, to=list(names))
    slopes, errors = [], []
    for name in names:
        one = np.asarray(found[quantity, name].value)
        if one.ndim > 1:
            one = np.sum(values * one, axis=1) / np.maximum(np.linalg.norm(values, axis=1), 1e-300)
        slopes.append(one[place])
        errors.append(np.full(len(place), found[quantity, name].error))
    return np.array([np.transpose(slopes), np.transpose(errors)])


LONG = 30  #: characters of a quantity above which it stands over its axes, in lines, and not beside them


def labelled(axis: Any, name: str, unit: str) -> None:
    """Write a quantity with its unit beside its axis, or over the axes where it is long; an expression, whose unit is not known,
    stands alone."""
    own = "" if not unit and not name.replace(".", "").replace("_", "").isalnum() else f"[{unit or '-'}]"
    if len(name) <= LONG:
        axis.set_ylabel(f"{name} {own}".strip())
        return
    axis.set_title(fill(name, 3 * LONG), loc="left", fontsize="small")
    axis.set_ylabel(own)


@dataclass(frozen=True, eq=False)
class Design(ListsAttributes):
    """A design that was found.

    values: of the numbers, by name; minimum: what was made least, in its unit, and error, its estimated error, None where it is
    exact or not known; of: what that was; bounds: list of Held; without_effect: names of numbers on which neither what was made
    least nor a bound depends; scene: with the values; result: its run, None where no run was needed; runs: number of runs made;
    found: whether the search ended at a least value with all bounds kept; message: why it ended."""

    values: dict[str, float]
    minimum: float
    error: float | None
    of: Any
    bounds: list[Held]
    without_effect: tuple[str, ...]
    scene: Any
    result: Result | None
    runs: int
    found: bool
    message: str

    def __str__(self) -> str:
        error = "" if self.error is None else f" +- {self.error:.1e}"
        lines = [f"least value {self.minimum:.6g}{error}", *(f"{name} = {value:.6g}" for name, value in self.values.items())]
        if self.without_effect:
            lines.append(f"without effect: {', '.join(self.without_effect)}")
        return "\n".join([*lines, *map(str, self.bounds), f"{self.message}; {counted(self.runs, 'run')}"])

    def plot(self, path: Any = None) -> Any:
        """A figure of what was made least, and of what is bounded, over the run of the design, with the limits of largest values,
        one axis for every quantity; path: a file to write it to. OptionError where masses alone were asked for."""
        asked = {one.quantity: None for one in (self.of, *(held.bound.of for held in self.bounds)) if isinstance(one, Objective)}
        if self.result is None or not asked:
            raise OptionError("there is nothing to draw: no number of a run was made least or bounded")
        figure, axes = new_figure(len(asked))
        for axis, name in zip(axes, asked, strict=True):
            axis.plot(self.result.t, self.result.value(name), **style(0))
            labelled(axis, named(name), unit_of(self.result, name))
            for held in self.bounds:
                if isinstance(held.bound.of, Objective) and (held.bound.of.quantity, held.bound.of.kind) == (name, "largest"):
                    for side in (1, -1) if np.min(self.result.value(name)) < 0 else (1,):
                        axis.axhline(side * held.bound.limit, color="0.55", linestyle="--")
        axes[-1].set_xlabel("t [s]")
        return written(figure, path)

    def __repr__(self) -> str:
        return f"<Design: {'; '.join(str(self).splitlines())}>"
