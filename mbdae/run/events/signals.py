"""Values of sensors over a run, for conditions. Sensors that loads may read are evaluated as for loads; all others are read from
results."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import symengine as se

from mbdae.errors import MbdaeError, OptionError, SceneError
from mbdae.inputs import tables, timed
from mbdae.inputs.breaks import TOLERANCE, distinct, tables_within
from mbdae.inputs.sensed import path_of, symbol
from mbdae.inputs.text import TIME
from mbdae.integrators.solution import Solution
from mbdae.results.result import Result
from mbdae.results.sensors import BodySensor, ConnectionSensor, quantities_of
from mbdae.results.started import started
from mbdae.scene.components import Body, Connection
from mbdae.scene.sensed import found as sensed
from mbdae.scene.sensor_names import drives_of, parsed, placed
from mbdae.symbolic.rebuild import nodes, substituted
from mbdae.symbolic.vectors import Expr
from mbdae.system.assembled.observed import Observer
from mbdae.system.base import Array
from mbdae.system.prepare import Prepared
from mbdae.values import BadValueError

MANY = 50_000  #: largest number of times that are evaluated at once


def check(scene: Any, path: str) -> None:
    """Raise BadValueError where a path such as "J.angle" names no quantity of the scene that results have."""
    try:
        sensed(scene, path)
    except BadValueError as refused:
        name, quantity, _ = parsed(path)
        try:
            item = placed(scene, name)[0]
        except SceneError:
            raise refused from None
        of_joints = (*quantities_of(ConnectionSensor), "length", "rate", *drives_of(item)) if isinstance(item, Connection) else ()
        known = quantities_of(BodySensor) if isinstance(item, Body) else of_joints
        if quantity not in known:
            raise (refused if "no sensor" in str(refused) else BadValueError(
                f"there is no sensor '{path}': '{name}' has {', '.join(known) or 'none'}")) from None  # fmt: skip


def may_be_observed(scene: Any, path: str) -> bool:
    """Whether a load could read the sensor: it does not depend on accelerations and reactions."""
    try:
        sensed(scene, path)
    except BadValueError:
        return False
    return True


def in_sensors(scene: Any, e: Expr) -> Expr:
    """An expression in which the symbols of named signals are replaced by the expressions of these signals."""
    named = {symbol(one.name): se.sympify(one.value) for one in scene.signals if one.kind == "signal"}
    while e.free_symbols & named.keys():
        e = substituted(e, named)
    return e


class Signals:
    """The time, the sensors and the tables of time that some expressions contain, as `symbols`, and their values over a
    solution."""

    def __init__(self, prepared: Prepared, solution: Solution, expressions: Sequence[Expr]) -> None:
        self._prepared, self.solution = prepared, solution
        read = sorted({s for e in expressions for s in e.free_symbols if path_of(s)}, key=str)
        self._tables = list(dict.fromkeys(node for e in expressions for node in nodes(e) if tables.lookup_of(node)))
        self._observer, self._shown = self._readers(read)
        self.symbols = [TIME, *read, *(se.Symbol(f"table_{n}") for n in range(len(self._tables)))]

    def _readers(self, read: list[Expr]) -> tuple[Any, dict[int, str]]:
        """An observer of the sensors that loads may read; index and path of each other sensor, which is read from results."""
        model, moved = self._prepared.model, self._prepared.all_bodies.moved
        observed, shown = [], dict[int, str]()
        for n, one in enumerate(read):
            if may_be_observed(model.scene, path_of(one)) and not _between_nodes(model, moved, one):
                observed.append(n)
            else:
                shown[n] = path_of(one)
        self._order = [*observed, *shown]
        return Observer(model, moved, [read[n] for n in observed]) if observed else None, shown

    def plain(self, e: Expr) -> Expr:
        """The expression with a symbol in place of every table."""
        return e.subs(dict(zip(self._tables, self.symbols[len(self.symbols) - len(self._tables) :], strict=True)))

    @property
    def edges(self) -> Array:
        """Times (m+1,) between which sensors are smooth: ends of steps, jumps and kinks of tables, and the
        ends of the intervals that limit steps along tables."""
        t = self.solution.t
        found = [part for e in self._tables for part in tables_within(e, float(t[0]), float(t[-1]), TOLERANCE)]
        return distinct(np.concatenate([t, *(times for part in found for times in part)]))

    def __call__(self, t: Array) -> Array:
        """Values of `symbols`, (k, number of symbols), at times (k,)."""
        return np.concatenate([self._some(part) for part in np.array_split(t, max(1, -(-len(t) // MANY)))])

    def _some(self, t: Array) -> Array:
        out = np.empty((len(t), len(self.symbols)))
        out[:, 0] = t
        count = len(self._order)
        values = np.empty((len(t), count))
        observed = count - len(self._shown)
        if self._observer is not None:
            values[:, self._order[:observed]] = self._observer(t, self.solution.interpolant.value(t))
        if self._shown:
            result = Result(self._prepared, self.solution, None, t)  # type: ignore[arg-type]
            for n, path in self._shown.items():
                values[:, n] = result.read(path)
        out[:, 1 : 1 + count] = values
        for n, table in enumerate(self._tables):
            out[:, 1 + count + n] = timed.values(table, t)
        return out


def _between_nodes(model: Any, moved: Any, one: Expr) -> bool:
    """Whether a sensor is at a place between the nodes of a beam, where only results can interpolate its value."""
    try:
        Observer(model, moved, [one])
    except SceneError:
        return True
    return False


def probe(prepared: Prepared, paths: Sequence[str]) -> None:
    """Raise OptionError where a sensor that loads may not read, so that it is read from results, is not a single number at the
    start."""
    paths = [path for path in paths if not may_be_observed(prepared.model.scene, path)]
    result = started(prepared) if paths else None
    for path in paths:
        assert result is not None
        try:
            found = result.read(path)
        except (MbdaeError, AttributeError) as error:
            raise OptionError(f"until, record: '{path}' cannot be read at the start: {error}; name another sensor") from None
        if found.ndim > 1:
            one = f"{path}[{', '.join('0' for _ in found.shape[1:])}]"
            raise OptionError(f"until, record: '{path}' is no single number; say which component, such as '{one}'")


