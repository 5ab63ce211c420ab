"""The way of `accuracy` and `solver` from `Scene.simulate` to the step goes down: nothing on it calls a layer above its own."""

from __future__ import annotations

import sys
from functools import cache
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import mbdae as mb

sys.path.insert(0, str(Path(__file__).parents[1]))

from test_layers import LEVEL

ROOT = Path(mb.__file__).parent
BELOW = ("run", "results", "integrators")


@cache
def folder(file: str) -> str:
    """Folder of mbdae, or module beside the folders, of a file; "" elsewhere."""
    return Path(file).relative_to(ROOT).parts[0].removesuffix(".py") if ROOT in Path(file).parents else ""


def layer(frame: FrameType | None) -> str:
    """The folder whose code a frame runs."""
    return folder(frame.f_code.co_filename) if frame is not None else ""


@pytest.mark.parametrize("options", [
    {}, {"solver": mb.IDA()}, {"solver": mb.HHT(), "accuracy": 1e-3}, {"solver": mb.RadauIIA(3), "verify": True},
], ids=["default", "IDA", "HHT", "verified"])
def test_no_call_leads_back_up(options: dict[str, Any]) -> None:
    s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
    s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0))
    up: set[str] = set()

    def watch(frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and (here := layer(frame)):
            caller = frame.f_back
            while caller is not None and not layer(caller):
                caller = caller.f_back
            if (above := layer(caller)) in BELOW and LEVEL[here] > LEVEL[above]:
                up.add(f"{above} calls {frame.f_code.co_qualname} of {here}")

    sys.setprofile(watch)
    try:
        s.simulate(0.2, **options)
    finally:
        sys.setprofile(None)
    assert not up
