"""Stored values and compiled functions, under keys made of digests.

A digest of what a law states: equal for equal expressions in all processes, different for all others.

Numbers enter bit by bit, symbols by their names, functions by their kinds. Values that a digest might not cover completely
(functions of SymPy, objects of a user's classes) have none.

The key of an entry is a hash of everything that it depends on:

statement: what the law answers on its frames: rows, coordinates, energies, forces, gaps, rates and starts of states, losses; of
    a joint whose friction follows from its reactions, the forces it states for the very reactions that were derived.
    Expressions are hashed node by node, numbers bit by bit. Names of classes, files and scenes are not in it: a law that is
    edited has another key, and laws that state the same share one
structure: kinds of nodes and structure of axes; absent parameters, parameters that depend on time; options; plain attributes of
    the class
outputs: the function of mbdae that selects them, by name; outputs of other packages are derived every time
tree: its shape, the motion of every joint, the keys of its laws
mbdae: a hash of all its Python sources. They are read where a file is new or has changed, by size, number and times of content
    and of change, so that a development checkout is seen too
releases: symengine with the size of its library (LLVM is in it), NumPy, Python
machine: system, processor, its instructions

What cannot be told completely (a function of one's own class in SymPy, an object of another kind) has no key and is derived and
compiled in every process. Methods of laws that are replaced show in what the law states; other functions of mbdae that are
replaced while Python runs are not seen: whoever does that sets `MBDAE_CACHE=off`. mbdae's own tests share a folder that lasts
for one run of them, and keep off it while they replace what derives or compiles (`tests/conftest.py`).
"""

from __future__ import annotations

import hashlib
import io
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

import symengine as se

from mbdae.disk import store, surroundings

#: classes that an entry may contain in addition to plain values: compiled functions, expressions, floats of NumPy
ALLOWED = {("symengine.lib.symengine_wrapper", "llvm_loading_func"), ("symengine.lib.symengine_wrapper", "load_basic"),
           ("numpy", "float64")}


def key_of(*parts: str) -> str | None:
    """The key of an entry from the digests of all it was made from; None where nothing is stored."""
    if not (store().used and surroundings()):
        return None
    return hashlib.sha256("\n".join((surroundings(), *map(repr, parts))).encode()).hexdigest()


def part_key(key: str | None, *part: str) -> str | None:
    """The key of a part of an entry."""
    return None if key is None else key_of("part", key, *part)


class _Reader(pickle.Unpickler):
    """Unpickler for plain values, expressions and compiled functions, which calls no other code."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) not in ALLOWED:
            raise pickle.UnpicklingError(f"{module}.{name} is not among what mbdae stores: this entry is not used")
        return super().find_class(module, name)


def recall(key: str | None) -> Any:
    """The value of an entry; None where there is none that can be read."""
    content = store().read(key) if key is not None else None
    if content is None or key is None:
        return None
    try:
        return _Reader(io.BytesIO(content)).load()
    except Exception:  # any error means a damaged entry: it is removed and made again
        store().remove(key)
        return None


def keep(key: str | None, value: Any) -> None:
    """Store a value that is not None, unless it cannot be stored."""
    if key is None:
        return
    try:
        content = pickle.dumps(value, protocol=5)
        _Reader(io.BytesIO(content)).load()
    except Exception:  # a part cannot be stored: the value is made anew in every process
        return
    store().write(key, content)


PLAIN = ("Zero", "One", "NegativeOne", "Half", "Integer", "Rational", "Pi", "Exp1", "BooleanTrue", "BooleanFalse", "Infinity",
         "NegativeInfinity", "NaN", "GoldenRatio", "EulerGamma", "Catalan", "ImaginaryUnit")  #: text identifies them
UNORDERED = ("Add", "Mul")
REFUSED = ("PyFunction", "PySymbol", "Dummy", "RealMPFR", "ComplexMPC", "ComplexDouble", "Complex")


class NoDigestError(Exception):
    """A value that a digest could not identify completely."""


MOST = 50_000  #: all remembered digests are forgotten where there are more than this when a new computation of digests begins
_known: dict[Any, str] = {}  #: digests of expressions met in this process: laws share the expressions of their frames


class Digests:
    """Computes digests of values, with each expression visited once."""

    def __init__(self) -> None:
        if len(_known) > MOST:
            _known.clear()
        #: number of floating-point zeros met. Expressions that contain one are not looked up in `_known`: symengine takes 0.0 and
        #: -0.0 for equal, but their digests must differ
        self._zeros = 0

    def of(self, value: Any) -> str:
        """The digest of plain values, expressions, vectors, and containers and data classes of them; NoDigestError for others."""
        if value is None or isinstance(value, bool | int | str):
            return f"{type(value).__name__} {value!r}"
        if isinstance(value, float):
            return f"float {value.hex()}"
        if isinstance(value, se.Basic) or hasattr(value, "_sympy_") or type(value).__module__.startswith("sympy."):
            return self._of_expression(se.sympify(value))
        return _short(self._of_container(value))

    def _of_container(self, value: Any) -> str:
        kind = type(value).__name__
        if isinstance(value, Enum):
            return f"{kind}.{value.name}"
        if isinstance(value, frozenset | set):
            return f"{kind} {sorted(map(self.of, value))}"
        if isinstance(value, Mapping):
            return f"{kind} {[(self.of(k), self.of(v)) for k, v in value.items()]}"
        if isinstance(value, tuple | list):
            return f"sequence {[self.of(v) for v in value]}"
        if is_dataclass(value) and not isinstance(value, type):
            return f"{kind} {[(f.name, self.of(getattr(value, f.name))) for f in fields(value)]}"
        if kind in ("Vec", "Motion") and type(value).__module__.startswith("mbdae.symbolic."):
            return f"{kind} {[self.of(v) for v in (value.c if kind == 'Vec' else value.steps)]}"
        raise NoDigestError(kind)

    def _of_expression(self, e: Any) -> str:
        found = _known.get(e)
        if found is None:
            before = self._zeros
            found = _short(self._text(e, type(e).__name__))
            if self._zeros == before:
                _known[e] = found
        return found

    def _text(self, e: Any, kind: str) -> str:
        if kind == "Symbol":
            return f"Symbol {e.name}"
        if kind == "RealDouble":
            self._zeros += float(e) == 0
            return f"RealDouble {float(e).hex()}"
        if kind in PLAIN:
            return f"{kind} {e}"
        if kind in REFUSED or not e.args or not type(e).__module__.startswith("symengine."):
            raise NoDigestError(kind)
        inner = [self._of_expression(a) for a in e.args]
        name = e.get_name() if kind == "FunctionSymbol" else ""
        return f"{kind} {name} {sorted(inner) if kind in UNORDERED else inner}"


def _short(text: str) -> str:
    return hashlib.blake2b(text.encode(), digest_size=20).hexdigest()

def code_key(symbols: Sequence[Any], expressions: Sequence[Any], level: int | None) -> str | None:
    """The key of compiled code, computed from symbols and expressions (not from a law) and from the compiler's optimisation
    level; None where nothing is stored."""
    if not (store().used and surroundings()):
        return None
    try:
        return key_of("code", Digests().of([list(symbols), list(expressions), level]))
    except Exception:  # an expression has no digest: it is compiled in every process
        return None
