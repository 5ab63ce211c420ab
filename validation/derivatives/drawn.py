"""Numbers of many scenes: each derivative is right, refused by name, or 0 where nothing of the motion changes with the number."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from random_scenes import random_scene
from runner import Found

import mbdae as mb
from mbdae.derivatives import Refined
from mbdae.formulations import default_form
from mbdae.scene.record import item_name
from mbdae.study.statements import call_of, changed

ACCURACY, END = 1e-6, 0.2
DRAWN = 6  #: numbers of a scene that are compared; all where None is given
#: distance of the values in differences: the motion changes by this share of itself, or the number, where that is less
DISTANCE = 2e-3
#: values of differences of order 4, first, and of order 8; on one side where there is no other
NEAR = {4: ((1, -1, 2, -2), (0, 1, 2, 3, 4), (0, -1, -2, -3, -4)),
        8: ((1, -1, 2, -2, 3, -3, 4, -4), tuple(range(9)), tuple(range(0, -9, -1)))}
EXACT = ((mb.DOP853(rtol=1e-13), 1e-13), (mb.RadauIIA(5, rtol=1e-12), 1e-11))  #: methods of runs, and their errors, of their size
PATIENCE = 5.0  #: s; a scene whose run by the first method takes longer is stiff and run by the second
#: differences of runs one after another, by order and by how much farther the values are apart, until one decides: nearer, where
#: a kink lies between the values (a clearance that closes); farther, where runs differ by more than the number changes them
TRIED = ((4, 1.0), (8, 1.0), (8, 1 / 16), (8, 8.0))
#: noise of a difference over what its nine values scatter about a polynomial of degree 5, which leaves three free: of scatter so
#: measured one in a hundred is less than a fifth of the true one, and a difference is rarely off by more than three times its own
UNSURE, DEGREE = 15.0, 5
FEWEST = 10  #: ratios of error to what is off of which a median is judged
NOTHING = 1e-10  #: a derivative below this share of the motion over the number counts as 0


def numbers(scene: Any) -> list[str]:
    """Names of all numbers in the statements of a scene, and its named numbers."""
    found = list(scene.numbers)
    for statement in scene.statements:
        item = item_name(statement)
        if isinstance(item, str):
            found += [f"{item}.{name}" for name in _inside(call_of(scene, scene.statements, item)[1])]
    return found


def _inside(data: Any) -> Iterator[str]:
    entries = data.items() if isinstance(data, dict) else enumerate(data)
    for key, value in entries:
        fields = value.get("fields", value.get("by", value)) if isinstance(value, dict) else value
        if isinstance(value, float | int) and not isinstance(value, bool):
            yield str(key)
        elif isinstance(fields, dict | list) and "expression" not in fields:
            yield from (f"{key}.{name}" for name in _inside(fields))


def drawn(seed: int) -> mb.Scene:
    """A random scene with masses of 1, -1 or 0 in some, a free body in some, and a number that two laws share in some."""
    rng, s = np.random.default_rng([seed, 43]), random_scene(seed)
    bodies = [name for name in (body.name for body in s.bodies) if f"{name}.mass" in numbers(s)]
    kind = seed % 5
    if kind < 3 and bodies:
        body = str(rng.choice(bodies))
        value = (1.0, -1.0, 0.0)[kind]
        try:
            s = changed(s, f"{body}.mass", value)[0]  # type: ignore[assignment]
            s.simulate(0.01)
        except mb.MbdaeError:  # no motion with this mass there
            s = changed(random_scene(seed), f"{body}.mass", 1.0)[0]  # type: ignore[assignment]
    elif kind == 3:
        free = s.rigid_body("free", 1.0, (0.1, 0.2, 0.15), at=(3, 1, 0), velocity=(0.3, 0.2, 0))
        s.spring("to free", s.ground, free, (3, 2, 0), (3.1, 1.2, 0), stiffness=mb.number("shared", 7.0),
                 damping=mb.number("shared", 7.0) / 20)
    else:
        one = s.rigid_body("one", 1.0, (0.1, 0.2, 0.15), at=(3.2, 1, 0))
        s.revolute("turns", s.ground, one, at=(3, 1, 0), axis=(0, 0, 1), spring=mb.number("shared", 2.0),
                   torque=mb.number("shared", 2.0) * mb.t - mb.number("drag", 0.1) * s.sensor("turns.rate"))
    return s


def motion(result: Any) -> Any:
    """(times, 6 x bodies) positions and velocities of all bodies of a result."""
    names = [b.name for b in result.prepared.model.scene.bodies]
    return np.hstack([np.asarray(result.value(f"{name}.{what}")) for name in names for what in ("position", "velocity")])


def weights(nodes: Sequence[int]) -> Any:
    """Weights of values at whole nodes by which their sum is the derivative at 0 of the polynomial through them."""
    powers = np.vander(np.array(nodes, dtype=float), increasing=True).T
    return np.linalg.lstsq(powers, np.eye(len(nodes))[1], rcond=None)[0]


class Reference:
    """Derivatives of what is read of a run, by differences of whole runs. base: the scene; read: function of a result that
    returns numbers (k,); end: s."""

    def __init__(self, base: Any, read: Any, end: float) -> None:
        self.base, self.read, self.end = base, read, end
        prepared = base.simulate(min(end, 1e-6), outputs=2).prepared
        #: of elastic bodies all vibrations are resolved: what steps pass over depends on their numbers too
        self.form = replace(default_form(prepared), waves=True) if prepared.model.elastic else None
        for self.solver, self.rounded in EXACT:
            try:
                run = base.simulate(end, solver=self.solver, form=self.form, outputs=2,
                                    max_wall=PATIENCE if self.solver is EXACT[0][0] else None)
            except mb.MbdaeError:
                if self.solver is EXACT[-1][0]:
                    raise
                continue
            if run.solution.complete:
                break
        self.own = np.asarray(read(run))
        self.most = float(np.abs(self.own).max()) or 1.0

    def run(self, by: Mapping[str, float]) -> Any:
        """What is read with some numbers larger."""
        scene = self.base
        for name, change in by.items():
            scene = changed(scene, name, lambda x, change=change: x + change, self.end)[0]
        return np.asarray(self.read(scene.simulate(self.end, solver=self.solver, form=self.form, outputs=2)))

    def value(self, name: str) -> float:
        """The number as it is stated, 1 where it is 0."""
        stated: list[float] = []
        changed(self.base, name, lambda x: stated.append(x) or x, self.end)  # type: ignore[func-returns-value]
        return abs(stated[0]) or 1.0

    def vanish(self, names: Sequence[str]) -> bool:
        """Whether nothing changes with numbers that are larger by 5 to 10 %."""
        by = {name: self.value(name) * (0.1 - 0.05 * i / len(names)) for i, name in enumerate(names)}
        return bool(np.abs(self.run(by) - self.own).max() <= NOTHING / 10 * self.most)

    def distance(self, name: str, size: float) -> float:
        """By how much a number is changed whose derivative is about `size`."""
        return DISTANCE * min(self.value(name), self.most / size if size else np.inf)

    def difference(self, by: Mapping[str, float], order: int) -> tuple[Any, float]:
        """The change (k,) of what is read, were it linear, when numbers change, and how far it may be off."""
        for nodes in NEAR[order]:
            try:
                runs = np.array([self.run({n: k * x for n, x in by.items()}) - self.own if k else 0 * self.own for k in nodes])
            except mb.MbdaeError:
                if nodes is NEAR[order][-1]:
                    raise
                continue
            break
        found, lower = (np.tensordot(weights(nodes[:k]), runs[:k], 1) for k in (None, -2))
        if order == 4:
            noise = float(np.abs(found - lower).max())
            if 0 not in nodes:  # each order lower by two is off by the same factor more
                noise *= min(noise / (float(np.abs(found).max()) or 1.0), 1.0)
        else:  # runs that scatter, or whose motion has a kink between the values, leave the same smooth polynomial
            at = np.array(sorted({0, *nodes}), dtype=float)
            rows = [runs[nodes.index(int(k))] if k in nodes else 0 * self.own for k in at]
            basis = np.linalg.qr(np.vander(at / np.abs(at).max(), DEGREE + 1, increasing=True))[0]
            left = np.array(rows) - basis @ (basis.T @ np.array(rows))
            scatter = float(np.linalg.norm(left, axis=0).max()) / np.sqrt(len(at) - DEGREE - 1)
            noise = UNSURE * scatter * float(np.linalg.norm(weights(nodes)))
        return found, noise + self.rounded * self.most * float(np.abs(weights(nodes)).sum())


KINDS = ("right", "zero", "told", "wrong", "uncovered", "refused", "no reference")


class Judged:
    """Derivatives (`one.value`, `one.error`) of what is read at the end, by name, compared with a reference. found: names by
    verdict (KINDS), and "wide": errors over what is off."""

    def __init__(self, reference: Reference, told: Mapping[str, Any], warned: str, found: dict[str, Any],
                 accuracy: float) -> None:
        self.reference, self.told, self.warned, self.found, self.accuracy = reference, told, warned, found, accuracy
        self.values = {name: np.ravel(one.value[-1]) for name, one in told.items()}
        self.sizes = {name: float(np.abs(value).max()) for name, value in self.values.items()}

    def zeros(self, names: Sequence[str]) -> None:
        """Numbers whose derivatives are 0, all at once; where something changes with them, one by one."""
        if not names or not self._made(lambda: self.reference.vanish(names), names):
            for name in names if len(names) > 1 else ():
                self.zeros([name])
            if len(names) == 1:
                self.some(names)
            return
        self.found["zero"] += names

    def _made(self, what: Any, names: Sequence[str]) -> Any:
        """What a function finds, None where the scene cannot be made or run with other values."""
        try:
            return what()
        except mb.MbdaeError as error:
            if len(names) == 1:
                self.found["no reference"].append(f"{names[0]}: {error}")
            return None

    def some(self, names: Sequence[str]) -> None:
        """Numbers that change at once, each by as much as changes the motion by the same share; one by one where that is not
        surely within their errors."""
        reference = self.reference
        by = {n: reference.distance(n, self.sizes[n] * len(names)) * (-1) ** i for i, n in enumerate(names)}
        change = sum(self.values[n] * x for n, x in by.items())
        error = sum(self.told[n].error * abs(x) for n, x in by.items())
        best = None
        for order, apart in TRIED if len(names) == 1 else TRIED[:1]:
            near = {n: apart * x for n, x in by.items()}
            made = self._made(lambda order=order, near=near: reference.difference(near, order), names if best is None else ())
            if made is None:
                break
            off, noise = float(np.abs(change - made[0] / apart).max()), made[1] / apart
            if off + noise <= error and (len(names) > 1 or noise <= error / 10):
                best = off, noise
                break
            if order > 4:
                best = (off, noise) if best is None or noise < best[1] else best
                if best[0] - best[1] <= error and best[1] <= self._bar(names[0]) * abs(by[names[0]]):
                    break
        if best is not None:
            if len(names) == 1 and best[1] <= error:
                self.found["wide"].append(error / (best[0] or best[1]))
            for name in names:
                self._one(name, abs(by[name]), *best, error)
        elif len(names) > 1:
            for name in names:
                self.some([name])

    def _bar(self, name: str) -> float:
        """By how much a derivative may be off."""
        return 10 * self.accuracy * self.sizes[name] + NOTHING * self.reference.most / self.reference.value(name)

    def _one(self, name: str, by: float, off: float, noise: float, error: float) -> None:
        nothing = NOTHING * self.reference.most / self.reference.value(name)
        largest, beyond = self.sizes[name], max(off - noise, 0.0) / by
        text = f"{name} ({largest:.9g}, off {off / by:.1e}, error {error / by:.1e}, noise {noise / by:.1e})"
        bar = self._bar(name)
        if beyond > 3 * error / by + nothing or (beyond > bar and f"'{name}'" not in self.warned):
            kind = "wrong"
        elif beyond > bar:
            kind = "told"
        else:  # a reference that is itself off by more than the bar finds nothing wrong and shows nothing right
            kind = "right" if noise / by <= bar else "no reference"
        self.found[kind].append(text)
        if beyond > error / by + nothing:
            self.found["uncovered"].append(text)


def judge(base: Any, end: float, names: Any = None, seed: int = 0, options: Any = None, read: Any = motion,
          accuracy: float = ACCURACY, together: int = 4) -> dict[str, Any]:
    """Names of numbers by verdict (KINDS), and "wide": errors over what is off, of those that are not 0. names: how many numbers,
    all, or their names; together: how many are changed at once for the reference."""
    found: dict[str, Any] = {kind: [] for kind in (*KINDS, "wide")}
    known = numbers(base) if names is None or isinstance(names, int) else list(names)
    if isinstance(names, int) and len(known) > names:
        known = [str(name) for name in np.random.default_rng(seed).choice(known, names, replace=False)]
    run = base.simulate(end, accuracy=accuracy, outputs=2, **(options or {}))
    left = []
    for name in known:
        try:
            Refined(run, [name])
            left.append(name)
        except mb.DerivativeError as error:
            found["refused"].append(f"{name}: {error}")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        derivatives = run.sensitivity(read, to=left) if left else {}
    said = " ".join(str(one.message) for one in told)
    reference = Reference(base, lambda result: np.ravel(result.value(read)[-1]), end)
    by = Judged(reference, {name: derivatives[read, name] for name in left}, said, found, accuracy)
    none = [name for name in left if by.sizes[name] <= NOTHING * reference.most / reference.value(name)]
    by.zeros(none)
    for name in (left := [name for name in left if name not in none])[::together]:
        by.some(left[left.index(name) :][:together])
    return found


def counted(parts: list[dict[str, list[str]]]) -> list[Found]:
    """What the claim states of many scenes."""
    both = {kind: [one for part in parts for one in part[kind]] for kind in parts[0]}
    right = len(both["right"]) + len(both["zero"])
    compared = right + len(both["told"])
    said = (f"{right} derivatives right ({len(both['zero'])} of them 0), {len(both['told'])} beyond ten times the accuracy, with "
            f"a warning, {len(both['refused'])} refused, {len(both['no reference'])} without a reference")
    middle = float(np.median(both["wide"])) if len(both["wide"]) >= FEWEST else 0.0
    return [Found(len(both["wrong"]), 0, "derivatives", "wrong", note=f"{said}; wrong: {', '.join(both['wrong']) or 'none'}"),
            Found(len(both["uncovered"]), max(0.01 * compared, 1), "derivatives", "errors that do not cover",
                  note=", ".join(both["uncovered"])),
            Found(middle, 50, "errors", "median of errors over what is off",
                  note=f"of {len(both['wide'])} compared with a reference that is more exact than the error"
                       f"{'' if len(both['wide']) >= FEWEST else ', too few to judge'}")]
