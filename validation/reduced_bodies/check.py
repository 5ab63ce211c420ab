"""Reduced bodies against closed forms, whole matrices, turning beams, all freedoms of solids, and bodies with all modes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from reduced_bodies.beam import LENGTH, PER_LENGTH, SECOND, beam_matrices, on_a_hub
from reduced_bodies.beside import EXAMPLES, answered, apart, exudyn
from reduced_bodies.cost import derivatives, misunderstood, reduction, run
from reduced_bodies.draw import seen
from runner import Case, Claim, Found
from scenes import data
from scipy.linalg import eigh

import mbdae as mb

claim = Claim("reduced_bodies", "reduced bodies bend, vibrate, turn and buckle as theory and all freedoms say, and what their "
              "modes leave out is what verify=True tells, within a factor 3", 1e-3, "relative",
              "closed forms, Galerkin's method, SciPy on the whole matrices, bodies with all of their modes")
EI = 2.1e11 * SECOND
UNIT = np.sqrt(EI / PER_LENGTH)  #: rad/s
QUICK, WHOLE = range(4), range(40)


def beam(modes: int | None, elements: int = 10, **more: bool) -> mb.ReducedBody:
    return mb.ReducedBody.craig_bampton(*beam_matrices(elements), {"root": [0], "tip": [elements]}, modes, **more)


def cantilever(body: mb.ReducedBody, load: tuple[float, float, float]) -> float:
    """Deflection of the tip along y, m."""
    s = mb.Scene("cantilever")
    s.reduced_body("beam", body)
    s.weld("wall", s.ground, "beam.root", at=(0, 0, 0))
    s.force("F", "beam.tip", load)
    return float(s.equilibrium()["beam.tip"].position[0, 1])


def statics() -> Found:
    """So small a force that the square of the deflection does not count, across a cantilever."""
    size = 1e-3 * EI
    return Found(abs(cantilever(beam(0), (0, size, 0)) / (size * LENGTH**3 / (3 * EI)) - 1), 1e-6, quantity="deflection")


def frequencies() -> Found:
    """The first eight of the free body, modes chosen by accuracy 1e-3, against those of the whole matrices."""
    M, K, _ = beam_matrices(10)
    whole = np.sqrt(eigh(K.toarray(), M.toarray(), eigvals_only=True)[6:14]) / (2 * np.pi)
    return Found(float(np.max(np.abs(beam(None).frequencies[:8] / whole - 1))), 1e-4, quantity="frequency")


def column(share: float) -> Found:
    """A cantilever under a share of Euler's load, and a force across it."""
    pressed, across = share * np.pi**2 / 4 * EI, 1e-3 * EI
    k = np.sqrt(abs(share)) * np.pi / 2
    want = across * ((np.tan if share > 0 else np.tanh)(k) - k) / (pressed * k)
    return Found(abs(cantilever(beam(4, stiffening=True), (-pressed, across, 0)) / want - 1), quantity="deflection")


def turning(rate: str) -> list[Found]:
    """Clamped to a hub that turns, see rotating_beam_frequencies; a beam so slender that it is inextensible."""
    found = on_a_hub(20, 12, float(rate), slender=1e-3)
    known = data("rotating_beam_frequencies")["table"][rate]
    return [Found(max(float(np.min(np.abs(found / value - 1))) for value in known[kind]), quantity=kind) for kind in known]


def solid(shape: str, share: float) -> Found:
    from reduced_bodies.solids import error

    off, note = error(shape, share)
    return Found(off, quantity="force at the foot", note=note)


def beside(name: str, stiffer: float = 1.0) -> list[Found]:
    """Beside Exudyn on the same matrices, K times `stiffer`. Its floating frame is another one: the second order of the
    deformation, which both leave out (see `swinging`), differs, a sixteenth of it where the body is four times as stiff."""
    frequencies, places, note = apart(name, stiffer)
    return [Found(frequencies, 1e-8, quantity="frequencies with held interfaces"),
            Found(places, 1e-3 if stiffer == 1 else 5e-6, quantity="places", note=note)]


def swinging(stiffer: float) -> list[Found]:
    """A lattice of springs against its exact motion: what small deformations leave out falls with the square of the stiffness,
    to a fortieth where that is eight times; Exudyn's floating frame leaves out as much or more."""
    from reduced_bodies.lattice import off, ours, problem

    runs = [(k, ours(k, loads)) for k, loads in ((stiffer, True), (stiffer, False), (8 * stiffer, True))]
    (by_loads, without, eightfold), told = zip(*((off(k, places), said) for k, (places, said) in runs), strict=True)
    note = f"without stiffening {without[1]:.1e}"
    if exudyn():
        note += f", Exudyn {off(stiffer, np.array(answered(problem(stiffer))['runs'][-1]))[1]:.1e}"
    covered = max(m / said for (m, _), said in zip((by_loads, without, eightfold), told, strict=True))
    return [Found(by_loads[1], quantity="places", note=note),
            Found(eightfold[1] / by_loads[1], 1 / 16, "times", quantity="places, eight times as stiff"),
            Found(covered, 1.0, "times", quantity="error over accuracy.deformation")]


def priced(ratio: float, note: str) -> Found:
    return Found(ratio, 2.0, "times", quantity="CPU", note=note)


def derived() -> list[Found]:
    place, force = derivatives()
    return [Found(place, quantity="place of the tip"), Found(force, quantity="force in the hinge")]


def refused() -> Found:
    wrong = misunderstood()
    return Found(len(wrong), 0.0, "kinds", note=f"not named: {', '.join(wrong) or 'none'}")


def free_statics() -> Found:
    """As `statics`, of a body of free modes."""
    size = 1e-3 * EI
    body = mb.ReducedBody.free_interface(*beam_matrices(10), {"root": [0], "tip": [10]}, 0)
    return Found(abs(cantilever(body, (0, size, 0)) / (size * LENGTH**3 / (3 * EI)) - 1), 1e-6, quantity="deflection")


def judge(seeds: Sequence[int]) -> Found:
    """How many drawn bodies the error told misses by more than a factor 3."""
    found = [seen(seed) for seed in seeds]
    wrong = [v for v in found if v.wrong]
    above = [v.told / v.true for v in found if v.true > v.floor]
    return Found(len(wrong), 0.0, "bodies", note=f"told over true {min(above, default=1):.2f} to {max(above, default=1):.2f} of "
                 f"{len(above)} above the error in time; wrong: {', '.join(str(v.seed) for v in wrong) or 'none'}")


def cases() -> list[Case]:
    return [Case("cantilever", "equilibrium", statics), Case("free beam", "eigh", frequencies),
            Case("cantilever of free modes", "equilibrium", free_statics), Case("bad input", "reduction", refused),
            Case("derivatives", "Radau IIA", derived),
            *(Case(f"column, {share:g} of Euler's load", "equilibrium", lambda share=share: column(share))
              for share in (0.5, -0.5)),
            *(Case(f"beam on a hub, rate {rate}", "linearize", lambda rate=rate: turning(rate), rate != "2.0")
              for rate in ("2.0", "6.0", "12.0")),
            *(Case(f"{shape}, load at {share:g} of its lowest frequency", "Radau IIA",
                   lambda shape=shape, share=share: solid(shape, share), slow=True)
              for shape in ("plate", "bracket") for share in (0.1, 0.3)),
            *(Case(f"Exudyn's example, {name}", "Radau IIA", lambda name=name: beside(name), slow=True)
              for name in (EXAMPLES if exudyn() else ())),
            *(Case(f"Exudyn's example, {name}, 16 times as stiff", "Radau IIA", lambda name=name: beside(name, 16.0), slow=True)
              for name in (("hinge",) if exudyn() else ())),
            Case("swinging lattice of springs", "Radau IIA", lambda: swinging(0.125), slow=True),
            Case("cost of the reduction", "splu, eigsh", lambda: priced(*reduction()), slow=True),
            *(Case(f"cost of a run of 20 modes to {accuracy:g}", "Radau IIA", lambda accuracy=accuracy: priced(*run(accuracy)),
                   slow=True) for accuracy in (1e-3, 1e-4, 1e-5)),
            Case(f"{len(QUICK)} drawn bodies", "verify=True", lambda: judge(list(QUICK)), slow=True),
            Case("drawn bodies", "verify=True", judge, slow=True, parts=list(WHOLE))]
