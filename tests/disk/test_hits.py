"""A second process takes from disk what the first one derived and compiled, and finds the same numbers to the last bit."""

import os
import subprocess
import sys
from pathlib import Path

RUN = """
import hashlib, sys
import mbdae as mb
import symengine as se
from mbdae.symbolic import derive
from mbdae.symbolic.program import Program
count = {"derived": 0, "compiled": 0}
run, compile, let = derive._Derivation.run, se.Lambdify, Program.let
def counted(self):
    count["derived"] += 1
    return run(self)
def stating(self, e):
    count["derived"] += 1
    return let(self, e)
def counting(*args, backend="lambda", **options):
    count["compiled"] += backend == "llvm"
    return compile(*args, backend=backend, **options)
derive._Derivation.run, se.Lambdify, Program.let = counted, counting, stating
"""
END = """
times = [0.1 * n for n in range(1, 5)]
states = b"".join(r(t).q.tobytes() + r(t).u.tobytes() for t in times) if hasattr(r(0.1), "q") else b""
numbers = b"".join(r[name].force.tobytes() for name in names) + r.energy.balance.tobytes()
print(count["derived"], count["compiled"], hashlib.sha256(states + numbers).hexdigest(), float(r[names[0]].force[-1][0]))
"""
PENDULUM = """
s = mb.Scene("pendulum", gravity=(0, -9.81, 0))
s.revolute("hinge", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), damper=0.1, spring=2.0, torque=0.3 * mb.t)
r, names = s.simulate(0.5), ["hinge"]
"""
LOOP = """
s = mb.Scene("loop", gravity=(0, -9.81, 0))
A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
crank, coupler, rocker = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.6), s.link("rocker", C, D, mass=0.5)
s.revolute("A", s.ground, crank, at=A, friction=mb.Coulomb(0.2, 0.01), radius=0.01)
s.revolute("B", crank, coupler, at=B)
s.revolute("C", coupler, rocker, at=C)
s.revolute("D", s.ground, rocker, at=D)
r, names = s.simulate(0.5, accuracy=1e-3), ["A", "C"]
"""
BEAM = """
s = mb.Scene("beam", gravity=(0, -9.81, 0))
beam = s.beam("beam", (0, 0), (1, 0), section=mb.Section.rectangular(0.02, 0.01, E=2e9, nu=0.3, rho=1e3), elements=2)
s.revolute("hinge", s.ground, beam, at=(0, 0))
r, names = s.simulate(0.5, accuracy=1e-2), ["hinge"]
"""
FED = """
s = mb.Scene("fed", gravity=(0, -9.81, 0))
rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
e = s.state("e", rate={rate}, start=0.1)
s.revolute("hinge", s.ground, rod, at=(0, 0), torque={torque})
s.controller("c", lambda t, angle: -angle, every=0.05, reads=["hinge.angle"], sets=["u"])
s.force("push", rod.at(1.0), (s.sensor("rod.velocity[0]"), 0, 0))
r, names = s.simulate(0.5), ["hinge"]
"""
TREE = """
s = mb.Scene("ordered tree", gravity=(0, -9.81, 0))
before, bodies = s.ground, []
for i in range(18):
    bodies.append(s.rigid_body(f"b{i}", 1.0, (0.1, 0.02, 0.1), at=(0.5 + i, 0, 0)))
    s.revolute(f"J{i}", before, bodies[-1], at=(i, 0, 0), axis=(0, 1, i % 2), damper=0.1, model=mb.Recursive())
    before = bodies[-1]
s.spring("spring", bodies[0], bodies[-1], (0, 0.1, 0), (18, 0.1, 0), stiffness=10.0)
s.force("push", bodies[4], (0, mb.t, 0))
r, names = s.simulate(0.5, accuracy=1e-2, solver=mb.SOLVER), ["J0"]
assert r.info.form == "ODE"
"""
RATE, TORQUE = "-s.sensor('hinge.angle')", "s.sensor('u') + 5 * e - 0.5 * s.sensor('hinge.rate')"
OWN = """
class Spring(mb.Force):
    params = mb.params(c="N/m")

    def energy(self, k, l):
        d = l.r - k.r
        return {factor} * self.c * (d @ d) / 2

s = mb.Scene("own", gravity=(0, -9.81, 0))
rod = s.link("rod", (0, 0), (1, 0), mass=1.0)
s.revolute("hinge", s.ground, rod, at=(0, 0))
s.add(Spring("spring", s.ground, rod, at=(0.5, 1, 0), at_l=(0.5, 0, 0), c=30.0))
r, names = s.simulate(0.5), ["hinge", "spring"]
"""


def run(tmp_path, statement, cache=None):
    """Derivations, compilations, hash of the result and a number of it, of a process."""
    return several(tmp_path, [statement], cache)[0]


def several(tmp_path, statements, cache=None):
    """The same of scenes one after the other in one process; derivations and compilations are those from its begin on."""
    environment = os.environ | {"MBDAE_CACHE": str(cache or tmp_path / "kept"), "PYTHONPATH": str(Path(__file__).parents[2])}
    code = RUN + "".join(statement + END for statement in statements)
    made = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=False,
                          env=environment)
    assert made.returncode == 0, made.stderr
    lines = [line.split() for line in made.stdout.splitlines()]
    return [(int(derived), int(compiled), found, float(number)) for derived, compiled, found, number in lines]


def test_the_second_process_derives_and_compiles_nothing(tmp_path):
    scenes = [PENDULUM, LOOP, BEAM, FED.format(rate=RATE, torque=TORQUE), OWN.format(factor=1),
              TREE.replace("SOLVER", "DOP853()"), TREE.replace("SOLVER", "RadauIIA(3)")]
    first, second, without = several(tmp_path, scenes), several(tmp_path, scenes), several(tmp_path, scenes[:-1], "off")
    derived = [one[0] for one in first]
    assert 0 < derived[0] < derived[-1]
    assert first[0][1] > 0
    assert [one[:2] for one in second] == [(0, 0)] * len(scenes)
    assert [one[2] for one in first] == [one[2] for one in second]
    assert [one[2] for one in first][:-1] == [one[2] for one in without]


def test_a_law_that_was_edited_is_derived_again(tmp_path):
    before, after = (run(tmp_path, OWN.format(factor=factor)) for factor in (1, 2))
    assert after[0] > 0
    assert after[3] != before[3]
    assert after[2] == run(tmp_path, OWN.format(factor=2), "off")[2]
    assert run(tmp_path, OWN.format(factor=1))[::2] == (0, before[2])


EDITS = [
    (RATE, TORQUE.replace("+ 5 * e", "+ 5 * e**2")), (RATE, TORQUE.replace("0.5 *", "0.5 * s.sensor('hinge.angle') *")),
    (RATE, TORQUE.replace("'hinge.rate'", "'rod.velocity[1]'")), (RATE, TORQUE.replace("'hinge.rate'", "'rod.velocity[0]'")),
    (RATE, TORQUE.replace("'u'", "'e'")), ("-s.sensor('hinge.rate')", TORQUE), ("-s.sensor('hinge.angle')**3", TORQUE),
]


def test_feedback_that_was_edited_is_derived_again(tmp_path):
    """Everything else is as before: the law, its parameters, the kinds of nodes."""
    scenes = [FED.format(rate=rate, torque=torque) for rate, torque in ((RATE, TORQUE), *EDITS)]
    before = run(tmp_path, scenes[0])
    after = several(tmp_path, scenes)
    assert after[0][::2] == (0, before[2])
    assert [one[2] for one in after] == [one[2] for one in several(tmp_path, scenes[::-1], "off")][::-1]
    assert len({one[2] for one in after}) == len(scenes)


def test_damaged_files_are_made_again(tmp_path):
    damages = [lambda whole: whole[: len(whole) // 2], lambda whole: whole[:-3] + b"abc", lambda whole: b""]
    first = run(tmp_path, PENDULUM)
    for number, file in enumerate((tmp_path / "kept").glob("*.kept")):
        file.write_bytes(damages[number % 3](file.read_bytes()))
    again = run(tmp_path, PENDULUM)
    assert again[:3] == first[:3]
    assert run(tmp_path, PENDULUM)[:2] == (0, 0)


def test_two_processes_at_once_find_the_same(tmp_path):
    environment = os.environ | {"MBDAE_CACHE": str(tmp_path / "kept"), "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-W", "ignore", "-c", RUN + PENDULUM + END]
    both = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    found = {one.communicate()[0].split()[2] for one in both}
    assert found == {run(tmp_path, PENDULUM)[2]}


def test_a_folder_that_cannot_be_used_changes_nothing(tmp_path):
    (tmp_path / "file").write_text("in the way")
    assert run(tmp_path, PENDULUM, tmp_path / "file")[2] == run(tmp_path, PENDULUM, "off")[2]


TOP = """
import hashlib
import mbdae as mb
s = mb.Scene("top", gravity=(0, 0, -9.81))
body = s.rigid_body("body", 1.5, (0.02, 0.02, 0.01), at=(0, 0.1, 0.3), angular_velocity=(0, 5, 30))
s.spherical("tip", s.ground, body, at=(0, 0, 0))
s.spring("spring", s.ground, body, (1, 0, 0), (0, 0.1, 0.3), stiffness=10.0)
print(hashlib.sha256(mb.export(s.recursive(), format="c").text.encode()).hexdigest())
"""


def test_exported_equations_do_not_hang_on_what_is_on_disk(tmp_path):
    """Nor on the hashes of Python, which are others in every process."""
    environment = os.environ | {"MBDAE_CACHE": str(tmp_path / "kept"), "PYTHONPATH": str(Path(__file__).parents[2])}
    found = {subprocess.run([sys.executable, "-c", TOP], capture_output=True, text=True, check=True,
                            env=environment | {"PYTHONHASHSEED": seed}).stdout for seed in ("1", "2")}
    assert len(found) == 1
