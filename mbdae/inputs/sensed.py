"""Sensors in expressions: symbols that carry the path of a sensor, such as sensor("J.angle")."""

from __future__ import annotations

import json
from functools import lru_cache
from typing import Any

import symengine as se

from mbdae.symbolic.vectors import Expr
from mbdae.values import BadValueError, shown

_HEAD = "sensor("


def symbol_name(path: str) -> str:
    """Name of the symbol of a sensor."""
    return f"{_HEAD}{json.dumps(path, ensure_ascii=False)})"


def symbol(path: str) -> Expr:
    """The symbol of a sensor, as symengine sees it."""
    return se.Symbol(symbol_name(path))


def path_of(name: Any) -> str:
    """The path of the sensor a symbol stands for; "" where it stands for none."""
    return _path(str(name))


@lru_cache(maxsize=4096)
def _path(text: str) -> str:
    if not (text.startswith(f'{_HEAD}"') and text.endswith('")')):
        return ""
    try:
        return str(json.loads(text[len(_HEAD) : -1]))
    except ValueError:
        return ""


def paths(value: Any) -> list[str]:
    """The sensors on which a number or expression depends, in the order of their paths."""
    return sorted({path for s in getattr(value, "free_symbols", ()) if (path := path_of(s))})


def refuse_symbols(value: Any, symbols: set[Expr], sensors: bool) -> None:
    """Raise BadValueError where an expression contains a symbol of no sensor, or one of a sensor although `sensors` is false."""
    others = sorted(str(s) for s in symbols if not (sensors and path_of(s)))
    if not others:
        return
    if path_of(others[0]):
        raise BadValueError(f"{shown(value)} depends on the sensor '{path_of(others[0])}': it may depend on the time mb.t "
                            f"alone; loads, states and signals may depend on sensors")  # fmt: skip
    allowed = "mb.t and sensors, s.sensor(path)," if sensors else "mb.t"
    raise BadValueError(f"{shown(value)} contains the symbol {others[0]}; only {allowed} may appear: put a number in its place")
