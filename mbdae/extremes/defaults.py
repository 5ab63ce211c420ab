"""What a map varies where the user names nothing: numbers of the run, and those that the scene states."""

from __future__ import annotations

import copy

import numpy as np

from mbdae.errors import OptionError
from mbdae.extremes.statements import call_of, name_of, set_speed
from mbdae.scene.scene import SceneData

FEW = 4  #: items of a kind that are varied


def default_vary(scene: SceneData) -> dict[str, list[float]]:
    """Accuracies and constant steps; masses, stiffnesses and speeds of what the scene states, by factors."""
    found: dict[str, list[float]] = {"accuracy": [1e-3, 1e-5, 1e-7], "step": [1e-2, 1e-4, 1e-6, 1e-8]}
    for kind, factors in (("mass", (1e-6, 1e-3, 1.0, 1e3, 1e6)), ("stiffness", (1.0, 1e3, 1e6)), ("speed", (1.0, 10.0, 100.0))):
        items = [name for name in (name_of(s) for s in scene.statements) if isinstance(name, str)]
        of_kind = [(name, now) for name in items if (now := current(scene, name, kind))]
        for name, now in of_kind[:FEW]:
            found[f"{name}.{kind}"] = [now * f for f in factors]
    return found


def current(scene: SceneData, item: str, kind: str) -> float | None:
    """The mass, stiffness or speed an item states; None where it states none."""
    index, bound = call_of(scene, scene.statements, item)
    method, call = scene.statements[index][0], bound.arguments
    if kind == "mass":
        body = next((b for b in scene.bodies if b.name == item), None)
        return body.mass if body is not None and method != "beam" else None
    if kind == "speed":
        try:
            return set_speed(copy.deepcopy(call), method, 1.0, item)
        except OptionError:
            return None
    model = call.get("model")
    normal = model.get("fields", {}).get("normal") if isinstance(model, dict) else None
    section = call.get("section")
    own = call.get("law", {}).get("values", {})
    for holder, key in ((call, "stiffness"), (own, "stiffness"), (call, "spring"), (section, "EA"), (normal, "stiffness")):
        fields = holder.get("fields", holder) if isinstance(holder, dict) else {}
        if fields.get(key) is not None:
            return float(np.max(np.abs(np.asarray(fields[key], dtype=float))))
    return None
