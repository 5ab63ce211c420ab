"""Derivatives of runs by every number of their scenes, against differences of exact runs: right, or refused."""

from __future__ import annotations

from collections.abc import Sequence

from derivatives.drawn import ACCURACY, DRAWN, END, counted, drawn
from derivatives.drawn import judge as judged
from derivatives.laws import LAWS, of_laws
from derivatives.remade import of_scenes
from derivatives.scenes import EXAMPLES, SCENES, example
from runner import Case, Claim, Found

claim = Claim("derivatives", "the derivative of what is read at the end of a run, by every number of its scene, is right within "
              "ten times the accuracy, or refused by name; `.error` covers it, at the median at most 50 times", 0.0, "scenes",
              "differences of order 4 and 8 of runs by DOP853 at 1e-13 or Radau IIA(5) at 1e-12")
FINE = 1e-8  #: the other accuracy at which errors are counted
QUICK, FEW, WHOLE = "pendulum", (9, 53), range(100)


def judge(names: Sequence[str], to: Sequence[str] = ()) -> list[Found]:
    """Derivatives in chosen and in drawn scenes, by names that may have an accuracy ("top at 1e-08", "7 at 1e-06"), each number
    by itself."""
    parts = []
    for name, accuracy in (name.split(" at ") for name in names):
        if name in SCENES:
            scene = SCENES[name]
            parts.append(judged(scene.build(), scene.end, to or None, options=scene.options, read=scene.read[0],
                                accuracy=float(accuracy), together=1))
        else:
            parts.append(judged(drawn(int(name)), END, DRAWN, int(name), accuracy=float(accuracy), together=1))
    return counted(parts)


def no_silent_zero(seeds: Sequence[int]) -> list[Found]:
    """Numbers of drawn scenes."""
    return counted([judged(drawn(seed), END, DRAWN, seed) for seed in seeds])


def of_example(name: str) -> list[Found]:
    """All numbers of an example."""
    return counted([judged(example(name), END / 4)])


def cases() -> list[Case]:
    return [Case(QUICK, "chosen", lambda: judge([f"{QUICK} at {ACCURACY}"], SCENES[QUICK].to)),
            Case("every number", "chosen", judge, slow=True,
                 parts=[f"{name} at {a:g}" for name in [*SCENES, *WHOLE[::10]] for a in (ACCURACY, FINE)]),
            Case("drawn scenes", "chosen", lambda: no_silent_zero(FEW)),
            Case("all drawn scenes", "chosen", no_silent_zero, slow=True, parts=list(WHOLE)),
            Case("laws", "chosen", lambda: of_laws(["Revolute"])),
            Case("all laws", "chosen", of_laws, slow=True, parts=list(LAWS)),
            Case("changed scenes", "chosen", lambda: of_scenes(["door_closer", *FEW])),
            Case("all changed scenes", "chosen", of_scenes, slow=True,
                 parts=[*sorted(p.stem for p in EXAMPLES.glob("*.py") if "def scene(" in p.read_text(encoding="utf-8")), *WHOLE]),
            Case("examples", "chosen", of_example, slow=True, parts=sorted(p.stem for p in EXAMPLES.glob("*.py")), each=True)]
