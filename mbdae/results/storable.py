"""The statements of a scene as data to store; OptionError with item and remedy where they cannot be stored."""

from __future__ import annotations

import json
from collections.abc import Iterator
from inspect import signature
from typing import Any

from mbdae.errors import MbdaeError, OptionError, SceneError
from mbdae.scene.record import STATEMENTS, item_name
from mbdae.scene.replay import Known, refuse_losses, replay
from mbdae.scene.scene import SceneData
from mbdae.symbolic.fingerprint import fingerprint
from mbdae.symbolic.stated import own
from mbdae.system.model.model import Model
from mbdae.values import BadValueError


def statements(scene: SceneData) -> dict[str, Any]:
    """The data of a scene; OptionError where a scene built from it would differ."""
    data = {"name": scene.name, "gravity": scene.gravity.tolist(), "space": scene.space, "statements": scene.statements}
    for method, args, kwargs in scene.statements:
        item = item_name([method, args, kwargs])
        for found in _inside([args, kwargs]):
            if "unreadable" in found:
                argument = found["unreadable"]
                raise OptionError(f"{method} '{item}' was given {argument}, which cannot be stored: give numbers, "
                                  f"texts, expressions of mb.t, laws, or a function defined with def")  # fmt: skip
            _check_name(f"{method} '{item}'", found.get("class", found.get("object", found.get("law"))))
    if set(scene.own) - set(Known().own):
        _check_own(scene, data)
    return data


def by_item(data: dict[str, Any]) -> dict[str, Any]:
    """Data of a scene with statements by kind and item, and their arguments by name, to describe a difference in words."""
    said: dict[str, Any] = {}
    for method, args, kwargs in data["statements"]:
        names = list(signature(STATEMENTS[method]).parameters)[1:]
        further = {f"argument {i}": v for i, v in enumerate(args) if i >= len(names)}
        named = dict(zip(names, args, strict=False)) | further | kwargs
        said[f"{method} '{item_name([method, args, kwargs])}', number {len(said) + 1}"] = named
    return data | {"statements": said}


def _inside(value: Any) -> Iterator[dict[str, Any]]:
    """All dictionaries inside plain data."""
    if isinstance(value, dict):
        yield value
    for part in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from _inside(part)


def _check_name(item: str, name: Any) -> None:
    """OptionError for the stored name of a class or function by which `mb.load` could not find it: of a lambda, or not unique."""
    if isinstance(name, str) and name.endswith("<lambda>"):
        raise OptionError(f"{item}: a lambda has no name by which it could be found again; define it with def, and pass it to "
                          f"mb.load in laws=[...]")  # fmt: skip
    if isinstance(name, str) and name.endswith(")"):
        raise OptionError(f"{item}: two classes or functions are called {name.rpartition(' ')[0]}, which the file could not tell "
                          f"apart; give each a name of its own")  # fmt: skip


def _check_own(scene: SceneData, data: dict[str, Any]) -> None:
    """OptionError where the user's own laws are not the same in a scene built again from the data."""
    try:
        refuse_losses(scene, replay(json.loads(json.dumps(data)), SceneData, Known(scene.own)))
    except MbdaeError as error:
        reason = "; ".join(error.problems) if isinstance(error, SceneError) else error
        raise OptionError(f"this scene could not be built again from what would be stored of it: {reason}; keep "
                          f"the script that states it, and its results by r.to_csv") from error


def own_laws(model: Model) -> dict[str, str]:
    """Fingerprints of the equations of the user's own laws, by name of the class and number of the group of laws with these
    equations in the model."""
    found = [group for group in model.groups if own(group.derived.law)]
    found.sort(key=lambda group: group.key[0].__module__.startswith("mbdae."))  # laws of mbdae with parts of the user's come last
    return {f"{group.key[0].__qualname__} {i}": fingerprint(group.derived) for i, group in enumerate(found)}


def check_laws(stored: dict[str, str], found: dict[str, str]) -> None:
    """BadValueError where a law given to `load` states other equations than those that were integrated. stored, found: by law the
    fingerprints in the file and those of the laws given."""
    for name in stored:
        if found.get(name) != stored[name]:
            raise BadValueError(f"the law {name.split()[0]} states other equations than when the file was written; hand over the "
                                f"class as it was: pass laws=[...]")  # fmt: skip
