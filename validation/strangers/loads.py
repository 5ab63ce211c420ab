"""Forces of a story for the reference: on coordinates of joints, between points, at points, in contact, fed back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import tanh
from typing import Any

import numpy as np
from strangers.bodies import Array, NotStatedError, World, option, three, unit
from strangers.story import Along, Feed, Input, Made, Said, Sampled, Story

LONGEST = 200  #: a run with contact or stops is divided into so many steps at least
Force = Callable[[float, Any, Array, Array], None]


@dataclass
class Held:
    """The output of a sampled controller, and what it reads."""

    f: Callable[..., float]
    every: float
    reads: list[tuple[str, int]]
    value: float = 0.0


class Loads:
    """Forces (n + 1, 6) on all bodies in a state, about their centres: force, then moment, inertial axes."""

    method = "DOP853"

    def __init__(self, story: Story, w: World, tracked: list[str]) -> None:
        self.w, self.tracked, self.longest = w, tracked, np.inf
        self.inputs: dict[int, Any] = {}
        self.given: list[Input] = story.inputs
        self.held: dict[str, Held] = {}
        self.all: list[Force] = []
        self.owners: list[str] = []  #: of every force, the statement that makes it
        self.steps = story.t_end / LONGEST
        for a in story.statements:
            made = getattr(self, f"_{a.verb}", None)
            if made is not None:
                made(a)
            if any(name.split(".")[0] == a.name for name in tracked):
                self._on_coordinates(a)
            self.owners += [a.name] * (len(self.all) - len(self.owners))

    # -- what changes between pieces

    def between(self, middle: float) -> None:
        """Take the smooth pieces at an instant inside them."""
        self.inputs = {id(i): i.derivative(middle) for i in self.given}

    def instants(self, T: float) -> list[float]:
        """Of sampled controllers."""
        return [n * h.every for h in self.held.values() for n in range(1, int(T / h.every) + 1)]

    def sample(self, t: float, m: Any, c: Array) -> None:
        """Let the controllers compute where it is their time."""
        for h in self.held.values():
            if abs(t / h.every - round(t / h.every)) < 1e-9:
                h.value = h.f(t, *(self._read(path, j, m, c) for path, j in h.reads))

    def _read(self, path: str, j: int, m: Any, c: Array) -> float:
        return float(c[j] if not path.endswith("rate") else m.rate[self.w.coordinates[self.tracked[j]]])

    def value(self, given: Any, t: float, m: Any, c: Array) -> float:
        """A load as it is stated."""
        if isinstance(given, Input):
            return float(self.inputs[id(given)](t))
        if isinstance(given, Feed):
            j = self.tracked.index(f"{given.joint}.{given.coordinate}")
            return given.of(float(c[j]), float(m.rate[self.w.coordinates[self.tracked[j]]]))
        if isinstance(given, Sampled):
            return self.held[given.name].value
        return float(given)

    def forces(self, t: float, m: Any, c: Array) -> Array:
        """All of them."""
        Q = np.zeros((len(self.w.names) + 1, 6))
        for force in self.all:
            force(t, m, c, Q)
        return Q

    # -- statements

    def _controller(self, a: Said) -> None:
        from strangers import laws

        made: Made = a.args["f"]
        reads = []
        for path in a.args["reads"]:
            joint, what = path.split(".")
            own = [n for n in self.tracked if n.split(".")[0] == joint]
            reads.append((path, self.tracked.index(f"{joint}.{what}" if what != "rate" else own[0])))
        self.held[a.args["sets"][0]] = Held(laws.Holding(**made.args), a.args["every"], reads)

    def _on_coordinates(self, a: Said) -> None:
        for name in [c for c in self.tracked if c.split(".")[0] == a.name]:
            j, n, c0 = self.tracked.index(name), self.w.coordinates[name], name.split(".")[1]
            words = {word: option(a, word, c0) for word in ("spring", "damper", "load", "limits", "friction")}
            if any(value is not None for value in words.values()):
                self.all.append(self._coordinate(a, j, n, words))
        if str(a.args.get("model", "")).startswith("mb.Clearance"):
            self._clearance(a)

    def _coordinate(self, a: Said, j: int, n: int, words: dict[str, Any]) -> Force:
        spring, damper = words["spring"] or 0.0, words["damper"] or 0.0
        low, high = words["limits"] or (-np.inf, np.inf)
        stop = a.args["stop"].args if words["limits"] else {}
        rub = words["friction"].args if words["friction"] else {}
        radius, pressed = a.args.get("radius", 1.0), a.args.get("normal_force", 0.0)
        if stop:
            self.longest = min(self.longest, self.steps)

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            x, v = c[j], m.rate[n]
            f = -spring * x - damper * v
            if words["load"] is not None:
                f += self.value(words["load"], t, m, c)
            if x > high:
                f -= max(0.0, stop["stiffness"] * (x - high) + stop["damping"] * v)
            if x < low:
                f += max(0.0, stop["stiffness"] * (low - x) - stop["damping"] * v)
            if rub:
                f -= rub["mu"] * tanh(radius * v / rub["v_c"]) * pressed * radius
            Q += f * m.J[n].reshape(Q.shape)

        return force

    def _spring(self, a: Said) -> None:
        n, stiffness, damping = self._between(a), a.args["stiffness"], a.args.get("damping", 0.0)
        natural = a.args.get("length")
        natural = float(np.linalg.norm(three(a.args["at_l"]) - three(a.args["at_k"]))) if natural is None else natural

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            length = np.sqrt(2 * m.value[n])
            Q -= ((stiffness * (length - natural) + damping * m.rate[n] / length) / length) * m.J[n].reshape(Q.shape)

        self.all.append(force)

    def _own(self, a: Said) -> None:
        if a.args["law"] != "QuarticSpring":
            raise NotStatedError(a.args["law"])
        n, stiffness = self._between({**a.args, "at_k": a.args["at"]}), a.args["stiffness"]

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            Q -= stiffness * 2 * m.value[n] * m.J[n].reshape(Q.shape)

        self.all.append(force)

    def _between(self, a: Said | dict[str, Any]) -> int:
        args = a.args if isinstance(a, Said) else a
        k, l = self.w.number(args["k"]), self.w.number(args["l"])
        return self.w.scalars.add(3, k, l, r=self.w.inside(k, args["at_k"]), s=self.w.inside(l, args["at_l"]))

    def _bushing(self, a: Said) -> None:
        k, l = self.w.number(a.args["k"]), self.w.number(a.args["l"])
        points = {"r": self.w.inside(k, a.args["at"]), "s": self.w.inside(l, a.args["at"])}
        rows = [self.w.scalars.add(0, k, l, e, **points) for e in np.eye(3)]
        stiffness, damping = a.args["stiffness"], a.args["damping"]

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            for n, s, d in zip(rows, stiffness, damping, strict=True):
                Q -= (s * m.value[n] + d * m.rate[n]) * m.J[n].reshape(Q.shape)

        self.all.append(force)

    def _force(self, a: Said) -> None:
        i, load, own = self.w.number(a.args["body"]), a.args["value"], a.args.get("frame") == "body"
        at = a.args.get("at")
        r = np.zeros(3) if at is None else self.w.inside(i, at)

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            f = self._vector(load, t, m, c)
            f = m.R[i] @ f if own else f
            Q[i, :3] += f
            Q[i, 3:] += np.cross(m.R[i] @ r, f)

        self.all.append(force)

    def _torque(self, a: Said) -> None:
        i, load, own = self.w.number(a.args["body"]), a.args["value"], a.args.get("frame") == "body"

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            f = self._vector(load, t, m, c)
            Q[i, 3:] += m.R[i] @ f if own else f

        self.all.append(force)

    def _vector(self, load: Along, t: float, m: Any, c: Array) -> Array:
        return np.asarray(self.value(load.value, t, m, c) * np.array(load.direction))

    # -- contact

    def _contact(self, a: Said) -> None:
        k, l = self.w.number(a.args["k"]), self.w.number(a.args["l"])
        one, other = a.args["shape_k"], a.args["shape_l"]
        radius = other.args.get("radius", 0.0)
        s = self.w.inside(l, other.args["at"])
        r = self.w.inside(k, one.args["at"])
        n0 = self.w.along(k, unit(one.args["normal"])) if one.word == "Plane" else None
        push, rub = self._pushing(a.args["normal"]), self._rubbing(a.args.get("friction"))
        self.longest = min(self.longest, self.steps)

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            d = m.x[l] + m.R[l] @ s - m.x[k] - m.R[k] @ r
            if n0 is not None:
                n = m.R[k] @ n0
                gap = n @ d - radius
            else:
                n = d / np.linalg.norm(d)
                gap = np.linalg.norm(d) - radius - one.args["radius"]
            if gap < 0:
                self._touch(m, Q, k, l, m.x[l] + m.R[l] @ s - n * (radius + gap / 2), n, -gap, push, rub)

        self.all.append(force)

    def _clearance(self, a: Said) -> None:
        """A pin in its race, in the plane."""
        k, l, model = self.w.number(a.args["k"]), self.w.number(a.args["l"]), a.args["model"].args
        r, s = self.w.inside(k, a.args["at"]), self.w.inside(l, a.args["at"])
        push, rub = self._pushing(model["normal"]), self._rubbing(model.get("friction"))
        self.longest = min(self.longest, self.steps)

        def force(t: float, m: Any, c: Array, Q: Array) -> None:
            race = m.x[k] + m.R[k] @ r
            d = m.x[l] + m.R[l] @ s - race
            away = float(np.linalg.norm(d))
            deep = away - (model["outer"] - model["inner"])
            if deep > 0:
                n = d / away
                speed = n @ (m.v[l] + np.cross(m.o[l], m.R[l] @ s) - m.v[k] - np.cross(m.o[k], m.R[k] @ r))
                self._touch(m, Q, k, l, race + model["outer"] * n, -n, deep, push, rub, speed)

        self.all.append(force)

    def _touch(self, m: Any, Q: Array, k: int, l: int, x: Array, n: Array, deep: float, push: Any, rub: Any,
               speed: float | None = None) -> None:
        """A force along n on l at x, and friction there; `speed` at which the overlap grows, else that of the material."""
        slip = m.v[l] + np.cross(m.o[l], x - m.x[l]) - m.v[k] - np.cross(m.o[k], x - m.x[k])
        pressed = push(deep, -(n @ slip) if speed is None else speed)
        slip = slip - (n @ slip) * n
        v = float(np.linalg.norm(slip))
        f = pressed * n - (pressed * rub(v) / v * slip if v > 0 else 0.0)
        for i, sign in ((l, 1.0), (k, -1.0)):
            Q[i, :3] += sign * f
            Q[i, 3:] += sign * np.cross(x - m.x[i], f)

    def _pushing(self, law: Made) -> Callable[[float, float], float]:
        stiffness, damping = law.args["stiffness"], law.args.get("damping", 0.0)
        return lambda deep, speed: max(0.0, stiffness * deep**1.5 * (1 + damping * speed))

    def _rubbing(self, law: Made | None) -> Callable[[float], float]:
        if law is None:
            return lambda v: 0.0
        mu, v_c = law.args["mu"], law.args["v_c"]
        return lambda v: mu * tanh(v / v_c)

