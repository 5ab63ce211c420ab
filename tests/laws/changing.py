"""Laws that pull a point with the force `factor` c r towards the origin, each with another way to change the factor while Python
runs. `WAYS`: name -> how to set the factor, and the law for that factor."""

from __future__ import annotations

import contextvars
import dataclasses
import enum
import functools
import json
import os
import sys
import tempfile
import threading
import types
from collections import namedtuple
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import symengine as se
import sympy

import mbdae as mb
from mbdae.symbolic.vectors import ZERO, Vec

FACTORS = (3.0, 6.0)
FOLDER = Path(tempfile.mkdtemp(prefix="changing-laws-"))
Way = tuple[Callable[[float], None], Callable[[float], tuple[type[mb.Force], dict[str, Any]]]]
WAYS: dict[str, Way] = {}


class Pull(mb.Force):
    """The base of the laws; their factors are what they read."""

    params = mb.params(c=("N/m", "stiffness"))

    def factor(self) -> Any:
        return 1

    def energy(self, k, l):
        return self.factor() * self.c * ((l.r - k.r) @ (l.r - k.r)) / 2


def law(name: str, factor: Callable[..., Any], **members: Any) -> type[mb.Force]:
    """A law that reads its factor by a function, named in this module so that files can name it."""
    made = type(name, (Pull,), {"factor": factor, "__module__": __name__} | members)
    globals()[name] = made
    return made


def way(name: str, change: Callable[[float], Any], made: type[mb.Force], **options: Callable[[float], Any]) -> None:
    """Add a way: `change` sets the factor, `options` give the options of the law for a factor."""
    WAYS[name] = (lambda f: change(f) and None, lambda f: (made, {key: value(f) for key, value in options.items()}))


# ---- what functions read -----------------------------------------------------------------------------------------------------

LISTED, NAMED = [3.0], {"f": 3.0}
way("list in place", lambda f: LISTED.__setitem__(0, f), law("ByList", lambda self: LISTED[0]))
way("dictionary in place", lambda f: NAMED.update(f=f), law("ByDict", lambda self: NAMED["f"]))


def inner() -> float:
    return 3.0


def outer() -> float:
    return inner()


way("helper of a helper", lambda f: globals().update(inner=lambda: f), law("ByInner", lambda self: outer()))
scaled = functools.partial(lambda x, f: f * x, f=3.0)
way("partial replaced", lambda f: globals().update(scaled=functools.partial(lambda x, f: f * x, f=f)),
    law("ByPartial", lambda self: scaled(1.0)))
kept = functools.partial(lambda f: f, f=3.0)
way("keywords of a partial", lambda f: kept.keywords.update(f=f), law("ByKeywords", lambda self: kept()))
MODULE = types.ModuleType("numbers_of_ours")
way("attribute of a module", lambda f: setattr(MODULE, "f", f), law("ByModule", lambda self: MODULE.f))
way("function of a module", lambda f: setattr(MODULE, "g", lambda: f), law("ByModuleFunction", lambda self: MODULE.g()))


def coded() -> float:
    return 3.0


def other_code() -> float:
    return 6.0


CODES = {3.0: coded.__code__, 6.0: other_code.__code__}
way("code of a function", lambda f: setattr(coded, "__code__", CODES[f]), law("ByCode", lambda self: coded()))


def defaulted(f: float = 3.0) -> float:
    return f


def keyed(*, f: float = 3.0) -> float:
    return f


way("defaults of a helper", lambda f: setattr(defaulted, "__defaults__", (f,)), law("ByDefaults", lambda self: defaulted()))
way("keyword defaults", lambda f: setattr(keyed, "__kwdefaults__", {"f": f}), law("ByKeywordDefaults", lambda self: keyed()))
attributed = lambda: attributed.f  # noqa: E731
way("attribute of a function", lambda f: setattr(attributed, "f", f), law("ByFunctionAttribute", lambda self: attributed()))
way("shadowed builtin", lambda f: globals().update(abs=lambda x: f), law("ByBuiltin", lambda self: abs(1.0)))


@functools.lru_cache
def remembered() -> float:
    return LISTED[0]


way("cleared memory", lambda f: (LISTED.__setitem__(0, f), remembered.cache_clear()), law("ByMemory", lambda self: remembered()))


def cell() -> tuple[Callable[[], float], Callable[[float], None]]:
    held = [3.0]
    return lambda: held[0], lambda f: held.__setitem__(0, f)


read_cell, write_cell = cell()
way("list in a closure", write_cell, law("ByCell", lambda self: read_cell()))
WRITTEN = "3.0"
way("evaluated text", lambda f: globals().update(WRITTEN=str(f)), law("ByText", lambda self: eval(WRITTEN)))
FORMULA = "3.0 * c / c"
way("formula as text", lambda f: globals().update(FORMULA=f"{f} * c / c"), law("ByFormula", lambda self: se.sympify(FORMULA)))

# ---- where constants may be --------------------------------------------------------------------------------------------------

PLACE, LOCAL = contextvars.ContextVar("f", default=3.0), threading.local()
way("context variable", lambda f: PLACE.set(f), law("ByContext", lambda self: PLACE.get()))
way("thread's own value", lambda f: setattr(LOCAL, "f", f), law("ByThread", lambda self: LOCAL.f))
way("environment variable", lambda f: os.environ.update(MBDAE_TEST_FACTOR=str(f)),
    law("ByEnvironment", lambda self: float(os.environ["MBDAE_TEST_FACTOR"])))
way("JSON file", lambda f: (FOLDER / "f.json").write_text(json.dumps({"f": f})),
    law("ByJson", lambda self: json.loads((FOLDER / "f.json").read_text())["f"]))
way("array file", lambda f: np.save(FOLDER / "f.npy", np.array([f])) or True,
    law("ByArrayFile", lambda self: float(np.load(FOLDER / "f.npy")[0])))
way("entry of sys.modules", lambda f: sys.modules.update(module_of_ours=types.SimpleNamespace(f=f)),  # type: ignore[dict-item]
    law("ByImport", lambda self: __import__("module_of_ours").f))


@dataclasses.dataclass
class Numbers:
    f: float = 3.0


Pair = namedtuple("Pair", "f g")
DATA, PAIR, SYMBOLIC, NUMBER, RATIO = Numbers(), Pair(3.0, 0.0), sympy.Integer(3), np.float64(3.0), Fraction(3)
way("data class", lambda f: setattr(DATA, "f", f), law("ByData", lambda self: DATA.f))
way("named tuple", lambda f: globals().update(PAIR=Pair(f, 0.0)), law("ByTuple", lambda self: PAIR.f))
way("number of SymPy", lambda f: globals().update(SYMBOLIC=sympy.Float(f)), law("BySymPy", lambda self: SYMBOLIC))
way("number of NumPy", lambda f: globals().update(NUMBER=np.float64(f)), law("ByNumPy", lambda self: float(NUMBER)))
way("fraction", lambda f: globals().update(RATIO=Fraction(f)), law("ByFraction", lambda self: float(RATIO)))

# ---- classes -----------------------------------------------------------------------------------------------------------------


class Meta(type(Pull)):  # type: ignore[misc]
    meta = 3.0


class Mixin:
    mixed = 3.0

    @classmethod
    def of_class(cls) -> float:
        return 3.0

    @staticmethod
    def static() -> float:
        return 3.0


class Above(Pull):
    """Between the laws and their base."""

    def factor(self) -> Any:
        return 3.0


class Kind(enum.Enum):
    SOFT, HARD = 3.0, 6.0


class Descriptor:
    f = 3.0

    def __get__(self, *_: Any) -> float:
        return self.f


ByMeta = Meta("ByMeta", (Pull,), {"factor": lambda self: type(self).meta, "__module__": __name__})
ByMixin = type("ByMixin", (Mixin, Pull), {"factor": lambda self: self.mixed, "__module__": __name__})
ByClassMethod = type("ByClassMethod", (Mixin, Pull), {"factor": lambda self: self.of_class(), "__module__": __name__})
ByStatic = type("ByStatic", (Mixin, Pull), {"factor": lambda self: self.static(), "__module__": __name__})
BySuper = type("BySuper", (Above,), {"factor": lambda self: super(BySuper, self).factor(), "__module__": __name__})
way("attribute of a metaclass", lambda f: setattr(Meta, "meta", f), ByMeta)
way("attribute of a mixin", lambda f: setattr(Mixin, "mixed", f), ByMixin)
way("class method replaced", lambda f: setattr(Mixin, "of_class", classmethod(lambda cls: f)), ByClassMethod)
way("static method replaced", lambda f: setattr(Mixin, "static", staticmethod(lambda: f)), ByStatic)
way("method above", lambda f: setattr(Above, "factor", lambda self: f), BySuper)
ByProperty = law("ByProperty", lambda self: self.value, value=property(lambda self: 3.0))
way("property replaced", lambda f: setattr(ByProperty, "value", property(lambda self: f)), ByProperty)
ByList2 = law("ByClassList", lambda self: self.listed[0], listed=[3.0])
way("list of a class", lambda f: ByList2.listed.__setitem__(0, f), ByList2)
ByNamespace = law("ByNamespace", lambda self: self.space.f, space=types.SimpleNamespace(f=3.0))
way("namespace of a class", lambda f: setattr(ByNamespace.space, "f", f), ByNamespace)
ByDescriptor = law("ByDescriptor", lambda self: self.described, described=Descriptor())
way("descriptor", lambda f: setattr(Descriptor, "f", f), ByDescriptor)
ByKind = law("ByKind", lambda self: self.kind.value, kind=Kind.SOFT)
way("member of an enumeration", lambda f: setattr(ByKind, "kind", Kind(f)), ByKind)

# ---- other answers, options, parts ---------------------------------------------------------------------------------------------


class ByWrench(mb.Force):
    params = mb.params(c=("N/m", "stiffness"))

    def wrench(self, k, l):
        return (k.r - l.r) * (LISTED[0] * self.c), ZERO


class ByThrust(mb.Force):
    params = mb.params(c=("N/m", "stiffness"))

    def thrust(self, k, l):
        return (l.r - k.r) @ k.y, -LISTED[0] * self.c * ((l.r - k.r) @ k.y)


class ByVector(mb.Force):
    params = mb.params(c=("N/m", "stiffness"))

    def wrench(self, k, l):
        return Vec(0, -LISTED[0] * self.c * (l.r - k.r)[1], 0), ZERO


for made in (ByWrench, ByThrust, ByVector):
    way(f"{made.__name__[2:].lower()}", lambda f: LISTED.__setitem__(0, f), made)


class Same:
    """Equal to all of its kind, whatever it holds."""

    def __init__(self, f: float) -> None:
        self.f = f

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Same)

    def __hash__(self) -> int:
        return 0


class Chosen(Pull):
    options = ("box",)

    def factor(self) -> Any:
        return self.box.f if hasattr(self.box, "f") else self.box[0] if isinstance(self.box, list | tuple) else self.box()


class Typed(Pull):
    options = ("mode",)

    def factor(self) -> Any:
        return 3.0 if isinstance(self.mode[0], int) else 6.0


BOX = Same(3.0)
way("option equal to another", lambda f: None, Chosen, box=Same)
way("option changed", lambda f: setattr(BOX, "f", f), Chosen, box=lambda f: BOX)
way("function as an option", write_cell, Chosen, box=lambda f: read_cell)
way("tuples of 1 and 1.0", lambda f: None, Typed, mode=lambda f: (1,) if f == 3.0 else (1.0,))


def scene(name: str, factor: float) -> mb.Scene:
    """A point at a distance of 1 m along y, pulled by the law of a way, whose factor is set."""
    change, made = WAYS[name]
    change(factor)
    cls, options = made(factor)
    s = mb.Scene("pulled")
    b = s.point_mass("b", 1.0, at=(0, 1.0, 0))
    s.add(cls("pull", s.ground, b, at=(0, 0, 0), at_l=(0, 1.0, 0), c=1.0, **options))
    return s


def pulled(name: str, factor: float) -> dict[str, float]:
    """The acceleration of the point at the start, -factor m/s^2: the job of a sweep."""
    return {"acceleration": float(scene(name, factor).simulate(0.01)["b"].acceleration[0, 1])}
