"""Phrases by which texts name quantities; laws of mbdae evaluated in a state of motion: constraint rows, their
forces by virtual work, potentials, contact geometry."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import symengine as se

from mbdae.audit.carried import expression_value
from mbdae.audit.evaluate import SizeError, Value
from mbdae.audit.motion import RandomMotion
from mbdae.errors import MbdaeError
from mbdae.laws import exported
from mbdae.laws.contact import Hertz
from mbdae.laws.friction import Coulomb
from mbdae.laws.joints import Revolute
from mbdae.laws.journal import JournalContact
from mbdae.laws.surfaces import SurfaceContact
from mbdae.reports.units import BASIC, law_faults, powers_of, scales, shown, unit
from mbdae.symbolic.derive import Derived, derive
from mbdae.symbolic.frames import Axes, Frame, NodeKind
from mbdae.symbolic.law import Element, Law
from mbdae.symbolic.part import Part

_SIDE = (NodeKind.SPATIAL, Axes.GENERAL)
_COORDINATE = (NodeKind.COORDINATE, Axes.GENERAL)
Own = tuple[tuple[str, type[Law]], ...]  #: classes of laws given by the user, by name


WITH_COORDINATES = " with coordinates"  #: suffix of the name of a joint, for its model with joint coordinates as unknowns


Rule = Callable[..., Value]
PARAMETER = re.compile(r"parameter (\w+) of (.+)$")  #: declaration of a law's parameter in a text


@dataclass(frozen=True)
class Phrase:
    """One kind of meaning: how it is worded and the rule that computes it."""

    pattern: re.Pattern[str]
    rule: Rule
    vanishes: bool  #: whether the quantity may be zero in a state the text speaks of
    #: of a force, the side of the equations of motion: "left", "applied", or "open" where texts differ; "" for other quantities
    side: str
    wording: str
    #: (name, unit, meaning) of quantities that the derivation contains and a text may leave out
    needs: tuple[tuple[str, str, str], ...] = ()
    given: bool = False  #: whether only the text knows the quantity (a number of its own); its rule draws it by the symbol's name
    drawn: bool = False  #: whether its rule draws a random value, seeded by the wording


PHRASES: list[Phrase] = []


def register(rules: Mapping[str, Rule], vanishes: bool = True, side: str = "", needs: tuple[tuple[str, str, str], ...] = (),
             given: bool = False, drawn: bool = False) -> None:
    """Register rules under their wordings, "axis {i} of {side}"; {side} is k or l, {i} 1 to 3, {name} a word, {...} any words.
    The further arguments are those of `Phrase`."""
    kinds = {"side": "(k|l)", "i": r"([123])", "name": rf"(\w+(?:{WITH_COORDINATES})?)"}
    for wording, rule in rules.items():
        plain = re.escape(wording).replace(r"\ ", " ")
        pattern = re.sub(r"\\\{(\w+)\\\}", lambda m: kinds.get(m[1].rstrip("0123456789"), "(.+?)"), plain)
        PHRASES.append(Phrase(re.compile(pattern + "$"), rule, vanishes, side, wording, needs, given, drawn or given))


def phrase(*wordings: str, **how: Any) -> Callable[[Rule], Rule]:
    """`register` for one rule, as a decorator."""

    def decorate(rule: Rule) -> Rule:
        register(dict.fromkeys(wordings, rule), **how)
        return rule

    return decorate


def random_number(wording: str) -> Rule:
    """Register a quantity given by the text, a random number of either sign in every state; returns its rule."""
    return phrase(wording, drawn=True)(lambda env: env.number(wording))


def random_positive(wording: str) -> Rule:
    """Register a quantity given by the text, a random positive number in every state; returns its rule."""
    return phrase(wording, vanishes=False, drawn=True)(lambda env: env.positive(wording))


def wordings() -> list[str]:
    """The wordings a meaning may have; {side} is k or l, {i} a digit, other braces are names or lists."""
    return sorted(re.sub(r"\d+\}", "}", p.wording) for p in PHRASES)


def law_class(name: str, own: Own = ()) -> type[Law] | None:
    """The class of a law by its name; None where there is none, or none with coordinates where the name asks for them. own: laws
    of the user."""
    plain = name.removesuffix(WITH_COORDINATES)
    found = (exported() | dict(own)).get(plain)
    if not (isinstance(found, type) and issubclass(found, Law)) or issubclass(found, Element | SurfaceContact):
        return None
    return found if plain == name or getattr(found, "coordinates", None) else None


def part_class(name: str, own: Own = ()) -> type[Part] | None:
    """The class of a normal law or friction law by its name; None where there is none. own: laws of the user."""
    found = (exported() | dict(own)).get(name)
    return found if isinstance(found, type) and issubclass(found, Part) else None


def derived(name: str, own: Own = (), declared: frozenset[str] = frozenset()) -> Derived:
    """A law derived between two bodies in space with all of its parameters; declared: parameters that the text names; own: the
    user's laws."""
    cls: Any = law_class(name, own)
    options: dict[str, Any] = {"joint": Revolute} if "joint" in cls.options else {}
    values = dict.fromkeys(cls.params, 1.0)
    if cls is JournalContact:
        options = {"normal": Hertz(1.0), "friction": Coulomb(1.0, 1e-3)}
        # the bearing length only where the text declares it: without it the pin touches in one plane
        values = dict.fromkeys({"outer", "inner"} | (declared & set(cls.params)), 1.0)
    if name.endswith(WITH_COORDINATES):
        options["kept"] = True
    law = cls("audited", None, None, **values, **options)
    return derive(cls, law.structure(), (_SIDE, _SIDE) + (_COORDINATE,) * len(law.own_coordinates))


class LawState:
    """A derived law in one state of motion, with values of all of its symbols."""

    def __init__(self, name: str, motion: RandomMotion, given: Mapping[str, float], own: Own = (), sides: str = "kl",
                 declared: frozenset[str] = frozenset()) -> None:
        """given: values of parameters by name, all others being random; sides: the bodies that are the law's k and l; declared:
        see `derived`."""
        self.d, self.motion = derived(name, own, declared), motion
        self.values: dict[Any, Any] = {}
        for f, side in zip(self.d.sides, sides, strict=True):
            self._frame(f, side)
        for c, (value, rate, _) in zip(self.d.frames[2:], motion.coordinates.values(), strict=False):
            self._put(c.q + c.u, [value, rate])
        for p in self.d.law.params:
            self._put([se.Symbol(p)], [given[p] if p in given else motion.positive(f"parameter {p}")])
        for row in self.d.rows:
            self._put([se.Symbol(f"lambda_{row}")], [motion.number(f"multiplier {row}")])
        for state in self.d.states:
            self._put([se.Symbol(f"state_{state}")], [motion.relative_angle()])  # states of such laws follow the angle

    def _frame(self, f: Frame, side: str) -> None:
        m = self.motion
        Q, w = m.rotation(side), m.of("w", side)
        for v, value in ((f.center, m.of("x", side)), (f.arm, np.zeros((3, 1))), (f.center_velocity, m.of("v", side)),
                         (f.w, w), (f.spin, Q.T @ w)):
            self._put(list(v), value[:, 0])
        for axes in ((f.x, f.y, f.z), f.body):
            for i, v in enumerate(axes):
                self._put(list(v), Q[:, i])

    def _put(self, symbols: Any, numbers: Any) -> None:
        plain = se.Integer if self.motion.symbolic else complex
        self.values.update((s, n if isinstance(n, se.Basic) else plain(n)) for s, n in zip(symbols, numbers, strict=True))

    def number(self, e: Any) -> Any:
        """The value of an expression in the law's symbols."""
        e = se.sympify(e)
        names = self.d.variation.values
        for name in e.free_symbols - self.values.keys():
            self.values[name] = self.number(names[name])
        if self.motion.symbolic:
            return e.subs({x: self.values[x] for x in e.free_symbols})
        return expression_value(e, self.values)

    def vector(self, v: Any) -> Value:
        """The value of a vector in the law's symbols."""
        return np.array([[self.number(c)] for c in v])

    def row(self, row: str) -> Value:
        """The value of a constraint row by its name."""
        return self.number(self.d.g[self.d.rows.index(row)])

    def row_gradient(self, row: str, part: str, side: str) -> Value:
        """Gradient (3, 1) of a constraint row by the displacement ("move") or rotation ("turn") of the body `side`."""
        return self.vector(self.d.G[self.d.rows.index(row)][side][part == "turn"])

    def row_force(self, row: str) -> Value:
        """Force s lambda + 2 p c that multiplies the gradient of a constraint row c: the potential of the row is s lambda c + p
        c^2, s the scaling and p the penalty of the joint."""
        s, p = (self.motion.positive(f"parameter {n}") for n in ("scaling", "penalty"))
        return s * self.motion.number(f"multiplier {row}") + 2 * p * np.real(self.row(row))

    def force(self, part: str, side: str) -> Value:
        """Force ("move") or torque ("turn") of a law on the body `side` (3, 1), as on the left-hand side of the equations of
        motion."""
        pair = self.d.force.get(side)
        return np.zeros((3, 1)) + 0j if pair is None else self.vector(pair[part == "turn"])


def journal(motion: RandomMotion, radii: tuple[float, float], sides: str, rubbing: bool = True) -> LawState:
    """Contact of a pin in its race; radii (outer, inner), m; sides: bodies of race and pin; rubbing: whether with friction."""

    def made() -> LawState:
        given = dict(zip(("outer", "inner"), radii, strict=True)) | {"friction_v_c": 1e-3, "normal_damping": 0.0}
        return LawState(JournalContact.__name__, motion, given if rubbing else given | {"friction_mu": 0.0}, sides=sides)

    return motion.once(("journal", radii, sides, rubbing), made)


def _sensor(contact: LawState, name: str) -> Any:
    v, d = contact.d.variation, contact.d
    (e,) = d.law.observed(*d.sides)[name]
    return v.resolve(v.name(e))


def observed(contact: LawState, name: str) -> Value:
    """The value of a sensor of the contact, by its name."""
    return contact.number(_sensor(contact, name))


def outward(contact: LawState) -> Value:
    """Unit vector from race centre to pin centre: the gradient of the penetration by the displacement of the pin."""
    v = contact.d.variation
    move, _ = v.gradient(contact.d.frames[1], _sensor(contact, "gap"))
    return -contact.vector(map(v.resolve, move))


# -- laws given by the user

#: functions of normal laws and friction laws, with the units of their arguments and of what they return
_FUNCTIONS = {"elastic_force": (("m",), "N"), "damping_force": (("m", "m/s"), "N"), "energy": (("m",), "J"),
              "coefficient": (("m/s",), "1")}


def of_laws(names: Iterable[str], own: Own) -> list[str]:
    """Which of the named laws, among those given by the user (`own`), have units that do not fit, in words; laws with an unknown
    unit are left out."""
    out = []
    for name in sorted(set(names) & set(dict(own))):
        try:
            found = _of_part(part_class(name, own)) if part_class(name, own) else law_faults(derived(name, own))
        except (MbdaeError, SizeError, ArithmeticError):
            continue
        out += [f"the law {name} that judges this has wrong units: {found[0]}"] if found else []
    return out


def _of_part(cls: Any) -> list[str]:
    """The functions of a normal law or friction law that return a wrong unit, in words."""
    if getattr(cls, "states", ()):
        return []
    for function, (units, wanted) in _FUNCTIONS.items() if cls else ():
        if function in vars(cls):
            before, *after = (np.array([[_returned(cls, function, units, seed, scale)] for seed in range(3)])
                              for scale in (dict.fromkeys(BASIC, 1.0), *scales()))
            p = powers_of(before, after)
            if p is None:
                return [f"its {function} has terms with different units"]
            if np.nanmax(np.abs(p[:, 0] - unit(wanted).powers), initial=0.0) > 1e-6:
                return [f"its {function} has the unit {shown(p)}, not {wanted}"]
    return []


def _returned(cls: Any, function: str, units: Sequence[str], seed: int, scale: Mapping[str, float]) -> float:
    """What a function of a law returns for random parameters and arguments (by seed), where m, kg and s have the sizes
    `scale`."""
    made, motion = object.__new__(cls), RandomMotion(seed)
    vars(made).update(dict.fromkeys(cls.options))
    vars(made).update({p: motion.positive(p) * unit(spec.unit).size(scale) for p, spec in cls.params.items()})
    arguments = [motion.positive(u) * unit(u).size(scale) for u in units]
    return float(np.real(expression_value(se.sympify(getattr(made, function)(*arguments)), {})))
