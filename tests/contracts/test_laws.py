"""Every exported law keeps the contract of laws; laws and derivations that break it are caught."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import symengine as se

import mbdae as mb
from mbdae import kernels as kernels_compile
from mbdae.contracts import checks
from mbdae.laws import beam, bodies, exported, joints, on_coordinates, surfaces
from mbdae.symbolic import derive as symbolic_derive
from mbdae.symbolic.law import Element, Law
from mbdae.symbolic.variation import Variation, rate
from mbdae.symbolic.vectors import ZERO

kernels_plan = sys.modules["mbdae.kernels.plan"]  # the package exports a function of that name
#: laws on lines and contacts of surfaces have tests of their own
LAWS = [law for law in exported().values() if issubclass(law, Law) and law.__module__ not in (beam.__name__, surfaces.__name__)]
#: others have their frictions, and as many coordinates; the report of Spherical is made below
LONG = ("JournalContact", "Planar", "PointOnPlane", "PointOnLine", "Prismatic", "FixedOrientation", "Universal",
        "JointFriction", "Free", "Cylindrical", "JointStop", "Screw", "JointSpring", "Bushing", "Spherical", "ClearanceRevolute")


@pytest.mark.parametrize("law", [pytest.param(law, marks=[pytest.mark.slow] * (law.__name__ in LONG)) for law in LAWS],
                         ids=lambda law: law.__name__)
def test_law_keeps_the_contract(law: Any) -> None:
    report = mb.selftest(law)
    bodiless = [*on_coordinates.__all__, "JointCoordinate"]  # these know no bodies
    assert len(report.variants) >= (1 if law.__name__ in bodiless else 4)
    assert set(report.worst) >= {"Jacobian", "compiled kernel"}
    assert "planar = spatial" in report.worst or law.__name__ in bodiless
    stated = issubclass(law, mb.Joint) and law.states_motion()
    assert ("motion" in report.worst) == stated
    if stated and law.coordinates:  # as unknowns, rubbed by the joint's reactions, and as the frames show them
        names = "\n".join(report.variants)
        rubs = law.scalars() and law not in (joints.Free, joints.FixedOrientation)  # there no reaction presses
        assert all(words in names for words in (("kept=True", "friction=LuGre") if rubs else ("kept=True",)))
        assert law.must_keep() or "spatial - spatial\n" in names or "spatial - spatial (without" in names
    assert all(error <= checks.BOUNDS[name] for name, (error, _) in report.worst.items())


def test_report_names_worst_entries() -> None:
    text = str(mb.selftest(mb.Spherical))
    assert "Spherical: 17 variants keep the contract" in text
    assert "Jacobian" in text
    assert "bound 1e-10" in text


# ---- laws of one's own -------------------------------------------------------------------------------------------------


class Screw(mb.Joint):
    """Turns about and travels along k.z."""

    params = mb.params(pitch=("m/rad", "travel per turn"))

    def constraints(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        rows = {"x": k.x @ d, "y": k.y @ d, "tilt_y": k.z @ l.x, "tilt_x": k.z @ l.y}
        return {**rows, "travel": k.z @ d - self.pitch * self.relative_angle(k, l)}


class NotObjective(mb.Force):
    """Depends on where the bodies are, not on how they lie to each other."""

    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.stiffness * (l.r[0] - 2 * k.r[0]) ** 2 / 2


class Pump(mb.Force):
    """Feeds energy and calls it dissipation."""

    params = mb.params(damping=("N s/m", "damping"))
    dissipative = True

    def wrench(self, k: Any, l: Any) -> Any:
        d = l.r - k.r
        return self.damping * (d @ (l.v - k.v - k.w.cross(d))) / (d @ d) * d, ZERO


class Gimbal(mb.Force):
    """An angle that has no derivative at half a turn."""

    params = mb.params(stiffness=("N m/rad", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.stiffness * se.acos((k.x @ l.x + k.y @ l.y + k.z @ l.z - 1) / 2) ** 2 / 2


class Optioned(mb.Force):
    options = ("power",)
    params = mb.params(stiffness=("N/m", "stiffness"))

    def energy(self, k: Any, l: Any) -> Any:
        return self.stiffness * ((l.r - k.r) @ (l.r - k.r)) ** self.power


class Nothing(mb.Joint):
    pass


class Rope(mb.Force):
    """A rope from k to m by a point of l that damps its stretching."""

    frames = ("k", "l", "m")
    params = mb.params(stiffness=("N/m", "stiffness"), length=("m", "length at rest"), damping=("N s/m", "damping"))

    def reach(self, k: Any, l: Any, m: Any) -> Any:
        return (l.r - k.r).norm() + (m.r - l.r).norm()

    def energy(self, k: Any, l: Any, m: Any) -> Any:
        return self.stiffness * (self.reach(k, l, m) - self.length) ** 2 / 2

    def dissipation(self, k: Any, l: Any, m: Any) -> Any:
        return self.damping * rate(self.reach(k, l, m)) ** 2 / 2

    def undefined_at(self) -> tuple[str, ...]:
        return ("points together",)


class SpinsByAxes(Rope):
    """Spins about axes of two bodies, which differ in a motion of all three together."""

    def dissipation(self, k: Any, l: Any, m: Any) -> Any:
        return self.damping * (m.w @ m.z - l.w @ l.z) ** 2 / 2


class Halfway(mb.Joint):
    """l stays halfway between k and m, as far from one as from the other."""

    frames = ("k", "l", "m")

    def constraints(self, k: Any, l: Any, m: Any) -> Any:
        return dict(zip("xyz", l.r * 2 - k.r - m.r, strict=True))


class Somewhere(Halfway):
    """Depends on where the bodies are."""

    def constraints(self, k: Any, l: Any, m: Any) -> Any:
        return dict(zip("xyz", l.r - k.r - m.r, strict=True))


class Massive(Element):
    """Kinetic energy that depends on the position: not what the derivation of inertia assumes."""

    params = mb.params(mass=("kg", "mass"))

    def kinetic_energy(self, b: Any) -> Any:
        return self.mass * (1 + b.center[0] ** 2) * (b.center_velocity @ b.center_velocity) / 2


def test_own_joint_passes() -> None:
    assert "spatial - spatial" in mb.selftest(Screw, pitch=0.01).variants


@pytest.mark.parametrize(("law", "count"), [pytest.param(Rope, 22, marks=pytest.mark.slow), (Halfway, 20)])
def test_laws_of_three_frames(law: Any, count: int) -> None:
    found = mb.selftest(law).variants
    assert len(found) == count
    assert {"spatial - spatial - spatial", "spatial - spatial - ground", "point - spatial - spatial"} <= set(found)


@pytest.mark.parametrize(
    ("law", "options", "said"),
    [
        (SpinsByAxes, {}, ["action = reaction, spatial - spatial - spatial: moment x"]),
        (Somewhere, {}, ["action = reaction, spatial - spatial - spatial: force x",
                         "invariance, spatial - spatial - spatial: row 'x'"]),
        (NotObjective, {}, ["action = reaction, spatial - spatial: force x", "invariance, spatial - spatial: energy"]),
        (Pump, {}, ["power, spatial - spatial: dissipated power, which is negative,"]),
        (Gimbal, {}, ["singular states, spatial - spatial: values half turn"]),
        (Nothing, {}, ["no variant can be derived", "states none of `motion(self, from_k)`, `constraints(self, k, l)`"]),
        (Optioned, {}, ["has the option 'power': say mb.selftest(Optioned, power=...)"]),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
@pytest.mark.usefixtures("between_bodies")
def test_broken_law_is_refused(law: Any, options: dict[str, Any], said: list[str]) -> None:
    with pytest.raises(mb.LawError) as caught:
        mb.selftest(law, **options)
    for words in said:
        assert words in str(caught.value)


@pytest.mark.usefixtures("between_bodies")
def test_option_given() -> None:
    assert mb.selftest(Optioned, power=2).variants


# ---- derivations that are wrong -----------------------------------------------------------------------------------------


@pytest.fixture
def fresh(between_bodies: None) -> Iterator[None]:
    """No derivation from before, none left behind."""
    symbolic_derive._known.cache_clear()
    yield
    symbolic_derive._known.cache_clear()


def test_geometric_stiffness_is_needed(monkeypatch: pytest.MonkeyPatch, fresh: None) -> None:
    """Without d(G^T lambda)/dq the Jacobian contract fails, and only there."""
    whole = kernels_plan.derivatives

    def without(d: Any, e: Any) -> Any:
        multipliers = {str(s) for s in d.multipliers}
        free = {str(s) for s in e.free_symbols}
        return {t: v for t, v in whole(d, e).items() if not (free & multipliers and t[0] == "q")}

    monkeypatch.setattr(kernels_plan, "derivatives", without)
    with pytest.raises(mb.LawError, match=r"Jacobian, spatial - spatial.*derivative of equation of motion 4 of k by q"):
        mb.selftest(mb.Weld)


def test_wrong_rotation_rule_is_found(monkeypatch: pytest.MonkeyPatch, fresh: None) -> None:
    """delta a = delta psi x a with the other sign breaks rates and virtual work."""
    right = Variation._direct_gradient

    def reversed_rule(f: Any, e: Any) -> Any:
        move, turn = right(f, e)
        return move, -turn

    monkeypatch.setattr(Variation, "_direct_gradient", staticmethod(reversed_rule))
    with pytest.raises(mb.LawError) as caught:
        mb.selftest(mb.Spherical)
    assert "rates, spatial - spatial: rate of row 'x'" in str(caught.value)
    assert "virtual work, spatial - spatial: equation of motion 4 of k" in str(caught.value)


def test_lost_gyroscopic_moment_is_found(monkeypatch: pytest.MonkeyPatch, fresh: None) -> None:
    from mbdae.contracts import case
    from mbdae.symbolic import outputs

    def without(d: Any) -> Any:
        (b,) = d.frames
        still = dict.fromkeys(b.spin, 0) if b.kind.turns else {}
        return [(t, e.subs(still)) for t, e in outputs.dynamics(d)]

    monkeypatch.setattr(case, "EVALUATED", tuple(without if o is outputs.dynamics else o for o in case.EVALUATED))
    monkeypatch.setattr(checks, "dynamics", without)
    with pytest.raises(mb.LawError, match="inertia, spatial: moment"):
        mb.selftest(bodies.RigidBody)


@pytest.mark.usefixtures("between_bodies")
def test_wrong_compilation_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    right = kernels_compile.Kernel.values
    monkeypatch.setattr(kernels_compile.Kernel, "values", lambda self, x: np.asarray(right(self, x)) * (1 + 1e-9))
    with pytest.raises(mb.LawError, match="compiled kernel"):
        mb.selftest(mb.Spherical)
