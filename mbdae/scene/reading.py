"""Reading what the user wrote: numbers, vectors and functions of time; every mistake becomes a problem of the scene."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mbdae.inputs import timed
from mbdae.scene.components import Array, Place


class Reading:
    """Collects `problems` instead of raising: they are reported together."""

    problems: list[str]

    def _number(self, item: str, option: str, value: Any, unit: str) -> float:
        try:
            number = float(value)
        except (TypeError, ValueError):
            self.problems.append(f"'{item}': {option} = {value!r} is not a number{f' ({unit})' if unit else ''}")
            return 0.0
        if not math.isfinite(number):
            self.problems.append(f"'{item}': {option} = {number} {unit} is not finite")
            return 0.0
        return number

    def _damping(self, item: str, option: str, value: Any, unit: str) -> float:
        number = self._number(item, option, value, unit)
        if number < 0:
            self.problems.append(f"'{item}': {option} = {number:g} {unit} is negative: it would feed energy; give 0 or more")
        return number

    def _array(self, item: str, option: str, value: Any, shape: tuple[int, ...] | None) -> Array:
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            self.problems.append(f"'{item}': {option} = {value!r} is not an array of numbers")
            return np.zeros(shape or 3)
        if shape is not None and array.shape != shape:
            self.problems.append(f"'{item}': {option} has shape {array.shape}, needs {shape}")
            return np.eye(3) if shape == (3, 3) else np.zeros(shape)
        if not np.all(np.isfinite(array)):
            self.problems.append(f"'{item}': {option} = {array.tolist()} is not finite")
            return np.asarray(np.nan_to_num(array, nan=0.0, posinf=0.0, neginf=0.0))
        return array

    def _vector(self, item: str, option: str, value: Any, unit: str) -> Array:
        array = self._array(item, option, value.point if isinstance(value, Place) else value, None)
        if array.shape == (2,):
            array = np.append(array, 0.0)
        if array.shape != (3,):
            self.problems.append(f"'{item}': {option} has shape {array.shape}, needs 2 or 3 numbers ({unit})")
            return np.zeros(3)
        return array

    def _axis(self, item: str, axis: Any) -> Array:
        direction = self._vector(item, "axis", axis, "")
        length = float(np.linalg.norm(direction))
        if length == 0:
            self.problems.append(f"'{item}': axis = {np.asarray(axis).tolist()} has length zero; give a direction")
            return np.array([0.0, 0.0, 1.0])
        return direction / length

    def _timed(self, item: str, option: str, value: Any, unit: str = "") -> Any:
        """None, a float, or an expression of time."""
        if value is None:
            return None
        try:
            e = timed.expression(value)
        except (TypeError, ValueError) as error:
            self.problems.append(f"'{item}': {option}: {error}")
            return 0.0
        return e if e.free_symbols else self._number(item, option, e, unit)
