"""Results that pictures are made of."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import mbdae as mb


def four_bar() -> mb.Scene:
    """Three links, one prescribed angle."""
    s = mb.Scene("four-bar </script>", gravity=(0, -9.81, 0))
    A, B, C, D = (0, 0), (0, 0.3), (0.5, 0.6), (0.6, 0)
    links = s.link("crank", A, B, mass=0.3), s.link("coupler", B, C, mass=0.6), s.link("rocker", C, D, mass=0.5)
    s.revolute("A", s.ground, links[0], at=A, angle=12.56 * mb.t)
    s.revolute("B", links[0], links[1], at=B)
    s.revolute("C", links[1], links[2], at=C, spring=2.0, damper=0.01)
    s.revolute("D", s.ground, links[2], at=D)
    return s


def zoo(planar: bool) -> mb.Scene:
    """One of every joint and force."""
    s = mb.Scene("zoo", gravity=(1, -9.81, 0 if planar else 1))
    z = 0.0 if planar else 0.4
    arm = s.link("arm", (0, 0, 0), (1, 0, 0), (1, 0.5, 0), mass=1.0)
    cart = s.rigid_body("cart", 2.0, 0.1 if planar else (0.1, 0.2, 0.25), at=(2, 0, z))
    bob = s.point_mass("bob", 1.0, at=(2, -1, z))
    fin = s.link("fin", (1, 0.5, 0), (1.3, 0.9, z), mass=0.1)
    mount = s.rigid_body("mount", 1.0, 0.01 if planar else (0.01, 0.01, 0.01), at=(-1, 0, 0))
    s.revolute("R", s.ground, arm, at=(0, 0), torque=2.0, spring=1.0)
    s.prismatic("P", s.ground, cart, at=(2, 0, z), axis=(1, 0, 0), spring=50.0)
    s.distance("rod", cart, bob, at_k=(2, 0, z), at_l=(2, -1, z))
    s.spring("S", arm, cart, at_k=(1, 0.5, 0), at_l=(2, 0, z), stiffness=10.0)
    s.weld("glue", arm, fin, at=(1, 0.5, 0))
    s.bushing("bush", s.ground, mount, at=(-1, 0, 0), stiffness=(100.0, 100.0, 0 if planar else 100.0))
    s.fixed_orientation("lock", s.ground, mount)
    s.force("push", cart, (5, 2, 0))
    s.torque("twist", arm, (0, 0, 3))
    if not planar:
        top = s.rigid_body("top", 1.0, (0.02, 0.04, 0.02), at=(0, 1, 1))
        s.spherical("tip", s.ground, top, at=(0, 0, 1))
    return s


@pytest.fixture(scope="session")
def bar() -> Any:
    return four_bar().simulate(0.6, accuracy=1e-3, outputs=31)


@pytest.fixture(scope="session", params=[True, False], ids=["planar", "spatial"])
def zoo_run(request: Any) -> Any:
    return zoo(request.param).simulate(0.4, accuracy=1e-3, outputs=np.linspace(0, 0.4, 11))


def flexible(planar: bool) -> mb.Scene:
    """A crank that drives a flexible rod; on it a beam with a corner, springs, a load; in space one more beam."""
    section = mb.Section.rectangular(0.02, 0.01, 1e8, 0.3, 1000, damping=1e-2)
    s = mb.Scene("flexible crank", gravity=(0, -9.81, 0), space="planar" if planar else "spatial")
    crank = s.link("crank", (0, 0), (0.3, 0), mass=1.0)
    rod = s.beam("rod", (0.3, 0), (1.5, 0), section=section, elements=4)
    hook = s.beam("hook", (0.9, 0), (0.9, -0.4), (1.1, -0.6), section=section, elements=3, order=3)
    block = s.rigid_body("block", 0.5, 0.01 if planar else (0.01, 0.01, 0.01), at=(1.5, 0))
    s.revolute("A", s.ground, crank, at=(0, 0), angle=10 * mb.t)
    s.revolute("B", crank, rod, at=(0.3, 0))
    s.revolute("C", rod, block, at=(1.5, 0))
    s.prismatic("D", s.ground, block, at=(1.5, 0), axis=(1, 0, 0))
    s.weld("E", rod, hook, at=(0.9, 0))
    s.spring("F", s.ground, hook, at_k=(1.1, -1), at_l=(1.1, -0.6), stiffness=20.0)
    s.force("G", rod.at(0.75), (0, 2 * mb.t, 0))
    s.spring("H", s.ground, rod, at_k=(0.6, 0.5), at_l=rod.at((0.6, 0.1)), stiffness=5.0)
    hook.load((1.0, 0.5 * mb.t), frame="section", name="wind")
    if not planar:
        s.weld("I", block, s.beam("whip", (1.5, 0, 0), (1.5, 0, 0.5), section=section), at=(1.5, 0, 0))
    return s


@pytest.fixture(scope="session", params=[True, False], ids=["planar", "spatial"])
def flexible_run(request: Any) -> Any:
    return flexible(request.param).simulate(0.4, solver=mb.RadauIIA(3, rtol=1e-6), outputs=np.linspace(0, 0.4, 11))
