"""Planar scenes that are or are not stable against motions out of their plane: told, or stable."""

from __future__ import annotations

import warnings

from out_of_plane.cases import Planar
from out_of_plane.cases import cases as scenes
from runner import Case, Claim, Found

import mbdae as mb

claim = Claim("out_of_plane", "planar scenes of beams and free bodies that are unstable against motions out of the plane say so "
              "once, others are called stable without a word", 0.0, "scenes", "closed forms: Euler, lateral buckling, Greenhill, "
              "a free body, strings; Ritz's method for a turning blade")


def said(case: Planar) -> tuple[str | None, int]:
    """What is said of the motions out of the plane, and by how many warnings."""
    scene = case.make()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        at = None if case.frame == "body" else scene.equilibrium(frame=case.frame or scene.ground)
        found = scene.linearize(at=at, frame=case.frame).out_of_plane
    return found, sum(issubclass(w.category, mb.AccuracyWarning) for w in told)


def judge(chosen: list[Planar]) -> Found:
    """The number of scenes about which something else is said than is right."""
    wrong = [c.name for c in chosen if said(c) != (c.right, int(c.right == "unstable"))]
    return Found(len(wrong), note=f"{len(chosen)} scenes; wrong: {', '.join(wrong) or 'none'}")


def cases() -> list[Case]:
    return [Case(f"{len(scenes())} scenes", "linearize", lambda: judge(scenes()))]
