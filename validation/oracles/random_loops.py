"""Mechanisms with loops as scenes of the package, and both compared with the reference written by hand (`loops.py`)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import mbdae as mb
from mbdae.results.sensors import wrenches
from mbdae.results.states import States
from mbdae.system.prepare import prepare
from oracles import loops
from oracles import overconstrained as over
from oracles.bodies import GROUND
from oracles.mechanisms import COORDINATE, acted, around, loop, node_accelerations, scene_of, second_loop, start_of, state_of

AGREE = 1e-9  #: of the largest acceleration, or force; what is measured is near 1e-13

#: single loops: joints from the ground to the ground by their letters, and what acts on them
CHAINS = {
    "RUSR": {},
    "RSSR": {"drives": (0,), "springs": (3,)},
    "RRURU": {"springs": (0, 1)},
    "RSPUR": {"springs": (2,)},
    "RPSRRR": {"springs": (1,), "drives": (0,)},
    "RRRRRRR": {},
    "RRPRRWUR": {"springs": (0, 2)},
    "PRDR": {},
    "RSDR": {"points": (1,)},
}
SPECIAL = {
    "planar": over.planar,
    "planar, driven": over.driven(over.planar),
    "slider-crank": lambda rng: over.planar(rng, "RRRP", springs=(0, 3)),
    "wedge": lambda rng: over.planar(rng, "PPP"),
    "parallelogram": over.parallelogram,
    "spherical": over.spherical,
    "Bennett": over.bennett,
    "Bennett, driven": over.driven(over.bennett),
    "Sarrus": over.sarrus,
    "Cardan": over.cardan,
    "Cardan, driven": over.driven(over.cardan),
    "one universal joint": over.one_joint_shaft,
    "welded twice": over.welded_twice,
    "door on two hinges": lambda rng: over.door(rng, 2),
    "door on two balls": lambda rng: over.door(rng, 2, "S"),
}
DOUBLE = {
    "RRURU, SUR": lambda rng: second_loop(rng, loop(rng, "RRURU"), "SUR", 0, -1, (2,)),
    "RSSR, D": lambda rng: second_loop(rng, loop(rng, "RSSR"), "D", 0, 2),
    "RPSRRR, RSU": lambda rng: second_loop(rng, loop(rng, "RPSRRR", springs=(1,)), "RSU", 1, 3, (0,)),
    "RRRRRRR, SPU": lambda rng: second_loop(rng, loop(rng, "RRRRRRR", drives=(0,), springs=()), "SPU", 2, -1, (1,)),
    "platform on three cranks": over.cranks,
    "platform on three cranks, driven": over.driven(over.cranks),
    "door on three hinges": over.door,
    "planar six-bar": over.six_bar,
    "spherical six-bar": lambda rng: over.six_bar(rng, True),
    "four-bar and SUS": over.crossed,
}
MODELS = ("kinematic", "classical", "recursive", "mixed")
ALL = {letters: (lambda rng, letters=letters: loop(rng, letters, **CHAINS[letters])) for letters in CHAINS}
ALL |= {name: over.under_forces(make) for name, make in (SPECIAL | DOUBLE).items()}


def scene(start, model, space="auto"):
    """The scene of a start with all its joints "kinematic", "classical", "recursive" (as many as form a tree), or "mixed"."""
    names = [j.name for j in start.mechanism.joints if j.kind in COORDINATE]
    models = {n: mb.Classical() if model == "classical" else mb.Kinematic() for n in names}
    if model == "mixed":
        models |= {n: mb.Classical() for n in names[1::2]} | {n: mb.Recursive() for n in names[:1]}
    made = scene_of(start.mechanism, models, start.hold, start.velocities, space)
    return made.recursive() if model == "recursive" else made


def drawn(name, seed, model="kinematic"):
    """A mechanism of the tables with its start, as near to where it is drawn as it must be to close, and its prepared scene."""
    rng = np.random.default_rng(seed)
    return closing(start_of(rng, ALL[name](rng)), model)


def closing(start, model):
    """A start as near to where it is drawn as it must be to close, and its prepared scene with joints in a model."""
    for share in (1.0, 0.3, 0.1):
        try:
            return start.nearer(share), prepare(scene(start.nearer(share), model))
        except mb.SceneError:
            continue
    return start.nearer(0.0), prepare(scene(start.nearer(0.0), model))


FREE = {"R": 1, "P": 1, "U": 2, "S": 3, "D": 5, "W": 0, "O": 3}  #: freedoms of a joint


def random_loop(seed):
    """The start of a mechanism: of five one is over-constrained, two have a second loop between any two of its bodies."""
    rng = np.random.default_rng([seed, 2])
    if seed % 5 == 0:
        return start_of(rng, over.under_forces(SPECIAL[str(rng.choice(list(SPECIAL)))])(rng))
    m = loop(rng, letters(rng, 4, 7), springs=(), drives=())
    if seed % 5 > 2:
        start, end = rng.choice([GROUND, *range(len(m.bodies))], 2, replace=False)
        m = around(rng, second_loop(rng, replace(m, springs=(), loads=()), letters(rng, 2, 4), int(start), int(end)))
    at = [i for i, j in enumerate(m.joints) if j.kind in COORDINATE]
    sprung = [i for i in at if rng.random() < 0.4]
    drives = [i for i in at if i not in sprung][:1] if rng.random() < 0.3 else []
    made = replace(m, joints=acted(rng, m.joints, sprung, drives))
    if not may_be_driven(made):
        made = replace(made, joints=tuple(replace(j, drive=None) for j in made.joints))
    return start_of(rng, made)


def may_be_driven(mechanism):
    """Whether the other joints leave what is driven free: three hinges between bodies that keep their orientation do not."""
    c = loops.constraints(mechanism, mechanism.drawn)
    return loops.decomposed(c.J)[2] == loops.decomposed(c.J[~c.driven])[2] + np.sum(c.driven)


def letters(rng, fewest, most):
    """Joints of a chain whose ends are held, which moves: seven freedoms or more."""
    while True:
        found = "".join(rng.choice(list("RRRPUSDWO"), int(rng.integers(fewest, most + 1))))
        if sum(FREE[a] for a in found) >= 7 and found.count("D") < 2 and "WW" not in found:
            return found


def solved(mechanism, prepared, t, q, u, closed=1e-9):
    """The reference at a state of a prepared scene, which it finds consistent: the state, its motion, and the accelerations
    (nu,) of all nodes."""
    state = state_of(prepared, t, q, u)
    c, speeds = loops.constraints(mechanism, state), np.hstack([state.v, state.w])[:-1].ravel()
    assert np.max(np.abs(c.g)) < closed
    assert np.max(np.abs(c.J @ speeds - c.speed)) < closed * (1 + np.max(np.abs(speeds)))
    motion = loops.solve(mechanism, state)
    joints = [j for j in mechanism.joints if j.kind in COORDINATE]
    of_joints = {j.name: loops.coordinate(mechanism, state, j, motion.a)[2] for j in joints}
    of_joints |= {f"{j.name}.{name}": loops.displacement(mechanism, state, j, axis, motion.a)[2] for j in mechanism.joints
                  for name, axis in zip("xyz", np.eye(3), strict=True) if j.kind == "fixed_orientation"}
    return state, motion, node_accelerations(prepared, state, motion.a, of_joints)


def far(one, other):
    """Largest difference over the largest value."""
    return float(np.max(np.abs(one - other), initial=0.0) / np.max(np.abs(other), initial=1e-300))


def reactions_off(mechanism, motion, found):
    """How far the reactions (joints, 6) are off that are unique, over the largest force or torque."""
    size = np.max(np.abs(motion.wrench))
    return float(np.max(np.abs(found - motion.wrench)[motion.unique], initial=0.0) / size)


def off(m, p):
    """How far accelerations and unique reactions at the start of a prepared scene are off, each over the largest, and by how much
    the rows of the reference contradict each other."""
    begin = p.start
    _, motion, expected = solved(m, p, begin.t, begin.q, begin.u)
    shown = wrenches(p, States(np.array([begin.t]), begin.q[None], begin.u[None], begin.s[None], None))[0]
    at = [c.name for c in p.model.scene.connections]
    return {"accelerations": far(begin.acceleration, expected), "contradiction": motion.contradiction,
            "reactions": reactions_off(m, motion, shown[[at.index(j.name) for j in m.joints]])}


def agree(m, p):
    """They are off by less than the bound."""
    for name, value in off(m, p).items():
        assert value < AGREE, name


def freedoms(mechanism, prepared):
    """Degrees of freedom and number of redundant rows by the reference."""
    begin = prepared.start
    state = state_of(prepared, begin.t, begin.q, begin.u)
    return loops.freedoms(mechanism, state, np.random.default_rng(1), 1)
