"""Joint-space dynamics against closed forms, differences, and Pinocchio where it is installed."""

from __future__ import annotations

import numpy as np
import pytest

import mbdae as mb

#: round-off of one evaluation, of numbers about 1 to 10
EXACT = 1e-11


def chain(count: int = 4, seed: int = 3) -> mb.Scene:
    """Bodies with any inertia on revolute and prismatic joints about any axes, the first floating where seed is even."""
    rng = np.random.default_rng(seed)
    s = mb.Scene("chain", gravity=(0.3, -1.0, -9.81))
    carrier = s.ground
    for i in range(count):
        A = rng.normal(size=(3, 3))
        J = 0.02 * (np.trace(A @ A.T) * np.eye(3) - A @ A.T)
        turned = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turned *= np.sign(np.linalg.det(turned))
        body = s.rigid_body(f"b{i}", 1 + rng.random(), J, at=rng.normal(size=3), rotation=turned)
        at, axis = rng.normal(size=3), rng.normal(size=3)
        if i or seed % 2:
            (s.prismatic if i == 2 else s.revolute)(f"J{i}", carrier, body, at=at, axis=axis)
        carrier = body
    return s


def test_pendulum_in_closed_form() -> None:
    s = mb.Scene("pendulum", gravity=(0, 0, -9.81))
    rod = s.rigid_body("rod", 2.0, (0.1, 0.2, 0.3), at=(0.5, 0, 0))
    s.joint(mb.Revolute, "J", s.ground, rod, at=(0, 0, 0), axis=(0, 1, 0), rotor=0.4, damper=7.0)
    tree, q = s.tree(), np.linspace(-3, 3, 5)[:, None]
    assert tree.names == ("J",)
    inertia = 0.2 + 2.0 * 0.25 + 0.4
    assert tree.mass_matrix(q) == pytest.approx(np.full((5, 1, 1), inertia), abs=EXACT)
    assert tree.gravity(q) == pytest.approx(-2.0 * 9.81 * 0.5 * np.cos(q), abs=EXACT)
    assert tree.forward_dynamics(q, np.ones((5, 1)), np.zeros(1)) == pytest.approx(-tree.gravity(q) / inertia, abs=EXACT)


@pytest.mark.parametrize("seed", [3, 4])
def test_dynamics_and_frames_agree_with_each_other(seed: int) -> None:
    s = chain(seed=seed)
    tree, rng = s.tree(), np.random.default_rng(seed)
    q, (v, a) = tree.zero + 0.0, rng.normal(size=(2, tree.nv))
    q[-3:] += rng.normal(size=3)
    tau = tree.inverse_dynamics(q, v, a)
    assert tree.forward_dynamics(q, v, tau) == pytest.approx(a, abs=EXACT)
    assert tree.mass_matrix(q) @ a + tree.bias(q, v) == pytest.approx(tau, abs=EXACT)
    assert tree.bias(q, np.zeros(tree.nv)) == pytest.approx(tree.gravity(q), abs=EXACT)
    at, h = (0.2, -0.1, 0.4), 1e-5
    if seed % 2:  # every coordinate a number: differences along v
        ahead, behind = (tree.pose("b3", q + step * v, at)[:, 3] for step in (h, -h))
        # differences of second order: h^2 and round-off over h
        assert (tree.jacobian("b3", q, at) @ v)[:3] == pytest.approx((ahead - behind) / (2 * h), abs=1e-8)
        rate = (tree.jacobian("b3", q + h * v, at) - tree.jacobian("b3", q - h * v, at)) / (2 * h)
        assert tree.jacobian_rate("b3", q, v, at) == pytest.approx(rate, abs=1e-7)


def test_accelerations_are_those_of_runs() -> None:
    s = chain(seed=3)
    found = s.tree().forward_dynamics(np.zeros(4), np.zeros(4), np.zeros(4))
    r = s.recursive().simulate(1e-3, accuracy=1e-9, outputs=[0.0, 1e-4, 2e-4, 1e-3])
    for i, joint in enumerate(("J0", "J1", "J2", "J3")):
        reached = (r[joint].displacement if joint == "J2" else r[joint].angle)[1]
        assert reached == pytest.approx(found[i] * 1e-8 / 2, rel=1e-3)  # of a start at rest, third order in 1e-4 s


def test_a_coupling_is_folded_in() -> None:
    s = mb.Scene("gripper")
    for name, y in (("one", 0.0), ("other", 1.0)):
        body = s.rigid_body(name, 1.0, (0.1, 0.1, 0.1), at=(0.5, y, 0))
        s.revolute(f"{name} hinge", s.ground, body, at=(0, y, 0), axis=(0, 0, 1))
    s.gear("mesh", "one hinge.angle", "other hinge.angle", -2.0)
    tree = s.tree()
    assert tree.names == ("one hinge",)
    assert tree.follows == ("other hinge.angle",)
    assert tree.mass_matrix([0.3]) == pytest.approx(np.array([[0.35 * 5]]), abs=EXACT)
    assert tree.forward_dynamics([0.3], [0.0], [1.0]) == pytest.approx([1 / 1.75], abs=EXACT)


def test_wrong_states_are_named() -> None:
    tree = chain(seed=4).tree()
    v = np.zeros(tree.nv)
    with pytest.raises(mb.OptionError, match="quaternion"):
        tree.mass_matrix(np.zeros(tree.nq))
    with pytest.raises(mb.OptionError, match="shape"):
        tree.bias(tree.zero[:-1], v)
    with pytest.raises(mb.OptionError, match="link"):
        tree.jacobian("nobody", tree.zero)


def test_frames_stay_with_copies_of_a_scene() -> None:
    s = chain(seed=3)
    s.frame("tool", "b3", at=(1, 2, 3))
    J = [one.tree().jacobian("tool", np.full(4, 0.2)) for one in (s, s.recursive())]
    assert J[0] == pytest.approx(J[1], abs=EXACT)


def test_frames_are_read_in_results_and_by_sensors() -> None:
    """Their origins, as `s.tree()` has them; in expressions, too."""
    ends = []
    for place in ("tool tip", "b.at(2, 0, 0)"):
        s = mb.Scene("one", gravity=(0, 0, -9.81))
        b = s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(1, 0, 0))
        s.revolute("J", s.ground, b, at=(0, 0, 0), axis=(0, 1, 0))
        s.frame("tool tip", b, at=(2, 0, 0))
        s.force("drag", b, (0, 0, -5 * s.sensor(f"{place}.velocity[2]")))
        r = s.simulate(0.1, accuracy=1e-8)
        ends.append(r["J"].angle[-1])
    tree, q = s.tree(), r["J"].angle[:, None]
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)
    assert r["tool tip"].position == pytest.approx(tree.pose("tool tip", q)[:, :, 3], abs=EXACT)
    velocity = tree.jacobian("tool tip", q[-1]) @ r["J"].rate[-1:]
    assert r.read("tool tip.velocity[2]")[-1] == pytest.approx(velocity[2], abs=EXACT)
    with pytest.raises(mb.SceneError, match=r"no item 'tip'.*'tool tip'"):
        r["tip"]


def test_what_a_joint_does_not_have_is_missing_as_attributes_are() -> None:
    s = mb.Scene("slide", gravity=(0, 0, -9.81))
    s.prismatic("J", s.ground, s.rigid_body("b", 1.0, (0.1, 0.1, 0.1), at=(1, 0, 0)), at=(0, 0, 0), axis=(0, 0, 1))
    found = s.simulate(0.01)["J"]
    assert hasattr(found, "displacement")
    assert not hasattr(found, "angle")
    assert getattr(found, "drive", None) is None
    with pytest.raises(mb.OptionError, match="'J' has no angle; its coordinates: displacement"):
        _ = found.angle


@pytest.mark.parametrize("model", [mb.Recursive(), mb.Classical()])
def test_rows_of_joints_turn_the_linear_equations_into_theirs(model: mb.Recursive | mb.Classical) -> None:
    """Near rest M of the linear equations, in coordinates of the joints, is the mass matrix of the tree."""
    s = mb.Scene("two rods", gravity=(0, 0, -9.81))
    upper = s.rigid_body("upper", 2.0, (0.2, 0.2, 0.01), at=(0, 0, -0.5))
    lower = s.rigid_body("lower", 1.0, (0.1, 0.1, 0.01), at=(0, 0, -1.5))
    s.revolute("A", s.ground, upper, at=(0, 0, 0), axis=(0, 1, 0), model=model)
    s.revolute("B", upper, lower, at=(0, 0, -1), axis=(0, 1, 0), model=model)
    found, tree = s.linearize(), s.tree()
    N = np.linalg.inv(found.basis[[found.basis_names.index(f"{name}.rate") for name in tree.names]])
    np.testing.assert_allclose(N.T @ found.M @ N, tree.mass_matrix(tree.zero), atol=EXACT)


def test_welded_bodies_are_one_body_with_frames_of_their_own() -> None:
    """Parts welded to a link, between two joints, at a tip and on the ground, beside the same links stated whole."""
    parts, whole = (mb.Scene(name, gravity=(0, 0, -9.81)) for name in ("parts", "whole"))
    J, places = np.diag([0.02, 0.03, 0.04]), np.array([[0.5, 0.1, 0], [0.5, -0.1, 0.2], [1.4, 0, 0.1]])
    bodies = [parts.rigid_body(f"b{i}", 1.0 + i, J, at=at) for i, at in enumerate(places)]
    base = parts.rigid_body("base", 7.0, J, at=(0, 0, -1))
    parts.weld("on the ground", parts.ground, base, at=(0, 0, 0))
    parts.revolute("A", base, bodies[0], at=(0, 0, 0), axis=(0, 1, 0))
    parts.weld("glue", bodies[1], bodies[0], at=(0.5, 0, 0))
    parts.revolute("B", bodies[1], bodies[2], at=(1, 0, 0), axis=(0, 0, 1))
    mass, centre = 3.0, (places[0] + 2 * places[1]) / 3
    off = places[:2] - centre
    own = sum(((m * (d @ d * np.eye(3) - np.outer(d, d))) for m, d in zip((1, 2), off, strict=True)), 2 * J)
    link = whole.rigid_body("b1", mass, own, at=centre)
    tip = whole.rigid_body("b2", 3.0, J, at=places[2])
    whole.revolute("A", whole.ground, link, at=(0, 0, 0), axis=(0, 1, 0))
    whole.revolute("B", link, tip, at=(1, 0, 0), axis=(0, 0, 1))
    one, other = parts.tree(), whole.tree()
    q, v, tau = np.random.default_rng(0).normal(size=(3, 2))
    assert one.closing == ()
    assert one.forward_dynamics(q, v, tau) == pytest.approx(other.forward_dynamics(q, v, tau), abs=EXACT)
    assert one.mass_matrix(q) == pytest.approx(other.mass_matrix(q), abs=EXACT)
    assert one.pose("b0", one.zero)[:, 3] == pytest.approx(places[0], abs=EXACT)
    assert one.jacobian("b1", q) == pytest.approx(other.jacobian("b1", q, at=places[1] - centre), abs=EXACT)
    assert not np.any(one.jacobian("base", q))


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("head", ["q", "v", "tau"])
def test_inputs_that_are_not_finite_are_named(head: str, wrong: float) -> None:
    """Of one state, of several, and of functions that do not read the entry."""
    tree = chain(seed=4).tree()
    given = {"q": tree.zero + 0.0, "v": np.zeros(tree.nv), "tau": np.zeros(tree.nv)}
    given[head][2 if head == "q" else -1] = wrong
    entry = r"q\[2\] of b0 floats\.z" if head == "q" else rf"{head}\[{tree.nv - 1}\] of J3\.angle"
    said = f"^{head} has an entry that is not finite, {entry}"
    with pytest.raises(mb.OptionError, match=f"{said}; give"):
        tree.forward_dynamics(*given.values())
    many = {word: np.tile(one, (2, 3, 1)) for word, one in given.items()}
    with pytest.raises(mb.OptionError, match=rf"{said} in 6 of 6 states, the first of them \[0, 0\]; give"):
        tree.forward_dynamics(*many.values())
    many[head][:] = tree.zero if head == "q" else 0
    many[head][1, 2] = given[head]
    with pytest.raises(mb.OptionError, match=rf"{said} in state \[1, 2\]; give"):
        tree.forward_dynamics(*many.values())
    if head == "q":
        with pytest.raises(mb.OptionError, match=entry):
            tree.jacobian("b0", given["q"])
        with pytest.raises(mb.OptionError, match=r"at\[1\]; give"):
            tree.jacobian("b0", tree.zero, at=(0, wrong, 0))


def test_a_quaternion_of_another_length_is_named_with_its_state() -> None:
    s = mb.Scene("two", gravity=(0, 0, -9.81))
    for name in ("one", "other"):
        s.rigid_body(name, 1.0, (0.1, 0.2, 0.25), at=(0, 0, 0))
    tree = s.tree()
    q = np.tile(tree.zero, (5, 1))
    q[3, 10:] *= 2
    with pytest.raises(mb.OptionError, match=r"by 1, that of other floats.rotation in state \[3\]; .*\[10, 11, 12, 13\]"):
        tree.mass_matrix(q)
    with pytest.raises(mb.OptionError, match=r"by 1, that of other floats.rotation; divide"):
        tree.mass_matrix(q[3])


def test_numbers_of_any_kind_and_size_are_states() -> None:
    tree, states = chain(seed=3).tree(), [[1, 0, 2, 0], [0, 1, 0, -1]]
    expected = tree.mass_matrix(np.array(states, dtype=float))
    assert tree.mass_matrix(states) == pytest.approx(expected)
    assert tree.mass_matrix(states[1]) == pytest.approx(expected[1])
    assert tree.mass_matrix(np.asfortranarray(states, dtype=np.float32)) == pytest.approx(expected)
    assert tree.mass_matrix(np.zeros((0, 4))).shape == (0, 4, 4)
    assert np.all(np.isfinite(tree.gravity(np.full(4, 1e150))))
    with pytest.raises(mb.OptionError, match="shape"):
        tree.bias(np.zeros(5), np.zeros(3))  # as many numbers together


def test_welds_of_every_kind_leave_the_tree_as_it_is() -> None:
    """Loops of welds, own gravity, points, what reads a body that is welded: the tree knows of masses and joints alone."""
    s = mb.Scene("welds", gravity=(0, 0, -9.81))
    a, b, c = (s.rigid_body(name, 1.0, (0.1, 0.2, 0.25), at=at) for name, at in (
        ("a", (0, 0, 0)), ("b", (1, 0, 0)), ("c", (0, 1, 0.2))))
    light = s.rigid_body("light", 2.0, (0.1, 0.2, 0.25), at=(1, 0, 0), gravity=(0, 0, 0))
    point = s.point_mass("point", 3.0, at=(2, 0, 0))
    s.revolute("J", s.ground, a, at=(-1, 0, 0), axis=(0, 1, 0))
    for name, k, l in (("ab", a, b), ("bc", b, c), ("ac", a, c), ("light on", c, light), ("point on", b, point)):
        s.weld(name, k, l, at=(2, 0, 0) if l is point else (0, 0, 0))
    s.spring("within", a, b, at_k=(0, 0, 0), at_l=(1, 0, 0), stiffness=3.0)
    s.force("read", a, (0, 0, -3 * s.sensor("b.position[2]")))
    tree = s.tree()
    assert tree.names == ("J",)
    assert tree.closing == ("ac",)
    inertia = 4 * 0.2 + 1 + 4 + (1 + 0.2**2) + 2 * 4 + 3 * 9
    assert tree.mass_matrix([0.3]) == pytest.approx(np.array([[inertia]]), abs=EXACT)
    assert tree.gravity([0.0]) == pytest.approx([-9.81 * (1 + 2 + 1 + 3 * 3)], abs=EXACT)
    assert tree.pose("c", tree.zero)[:, 3] == pytest.approx([0, 1, 0.2])


def test_what_no_tree_carries_is_refused_by_name() -> None:
    """Bodies that a distance alone holds, and beams, would be left out of the mass matrix."""
    def arm():
        s = mb.Scene("arm", gravity=(0, 0, -9.81))
        b = s.rigid_body("b", 1.0, (0.12, 0.13, 0.15), at=(0, 0, -0.5))
        s.revolute("j", s.ground, b, at=(0, 0, 0), axis=(0, 1, 0))
        return s, b

    s, b = arm()
    p = s.rigid_body("pendant", 3.0, (0.1, 0.1, 0.1), at=(0, 0, -1))
    s.distance("rod", b, p, at_k=(0, 0, -0.5), at_l=(0, 0, -1))
    with pytest.raises(mb.SceneError, match="'pendant'"):
        s.tree()
    s, b = arm()
    c = s.beam("blade", (0, 0, -1), (1, 0, -1), section=mb.Section.rectangular(0.01, 0.01, E=1e9, nu=0.3, rho=1e3))
    s.weld("W", b, c, at=(0, 0, -1))
    with pytest.raises(mb.SceneError, match="'blade'"):
        s.tree()


@pytest.mark.parametrize("out_of_plane", [0, 1])
@pytest.mark.parametrize("ball_first", [True, False])
def test_a_ball_carries_a_body_in_planar_scenes_too(ball_first: bool, out_of_plane: float) -> None:
    """A four-bar that a ball and a hinge close: the one that is stated first carries the last body."""
    s = mb.Scene("four-bar", gravity=(0, -9.81, out_of_plane))
    crank, coupler, rocker = (s.rigid_body(name, 1.0, (0.01, 0.02, 0.03), at=at) for name, at in (
        ("crank", (0, 0.15)), ("coupler", (0.25, 0.45)), ("rocker", (0.55, 0.3))))
    s.revolute("A", s.ground, crank, at=(0, 0))
    s.revolute("B", crank, coupler, at=(0, 0.3))
    statements = [lambda: s.spherical("C", coupler, rocker, at=(0.5, 0.6)),
                  lambda: s.revolute("D", s.ground, rocker, at=(0.6, 0))]
    for state in statements if ball_first else reversed(statements):
        state()
    tree = s.tree()
    assert (tree.names, tree.closing) == ((("A", "B", "C"), ("D",)) if ball_first else (("A", "B", "D"), ("C",)))
    of_coupler, of_rocker = 0.03 + 0.25**2 + 0.15**2, 0.03 + 0.55**2  # about B
    assert tree.mass_matrix(tree.zero)[1, 1] == pytest.approx(of_coupler + (of_rocker if ball_first else 0))


def test_a_link_that_turns_about_itself_without_inertia_is_named() -> None:
    s = mb.Scene("spit", gravity=(0, 0, -9.81))
    s.revolute("j", s.ground, s.link("a", (0, 0, 0), (1, 0, 0), mass=1.0), at=(0, 0, 0), axis=(1, 0, 0))
    with pytest.raises(mb.SceneError, match=r"j\.angle: no inertia"):
        s.tree().forward_dynamics([0.0], [0.0], [1.0])


def turned(J, kind):
    """A body of principal moments J on a ball, or on two hinges."""
    s = mb.Scene("turned", gravity=(0, 0, -9.81))
    b = s.rigid_body("b", 1.0, J, at=(0, 0, 0))
    if kind == "ball":
        s.spherical("S", s.ground, b, at=(0, 0, 0))
        return s
    a = s.rigid_body("a", 1.0, (0.1, 0.1, 0.1), at=(0, 0, 0))
    s.revolute("y", s.ground, a, at=(0, 0, 0), axis=(0, 1, 0))
    s.revolute("z", a, b, at=(0, 0, 0), axis=(0, 0, 1))
    return s


@pytest.mark.parametrize(("kind", "name"), [("ball", r"S\.rotation\[2\]"), ("hinges", r"z\.angle")])
def test_a_mass_matrix_that_is_singular_but_for_rounding_is_refused_at_each_state(kind: str, name: str) -> None:
    tree, rng = turned((0.1, 0.1, 0.0), kind).tree(), np.random.default_rng(1)
    q = rng.standard_normal((20, tree.nq))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    for one in (tree.zero, *q):
        with pytest.raises(mb.SceneError, match=f"{name}: no inertia is moved"):
            tree.forward_dynamics(one, np.zeros(tree.nv), np.ones(tree.nv))
    with pytest.raises(mb.SceneError, match=r"in 20 of 20 states, the first of them \[0\]"):
        tree.forward_dynamics(q, np.zeros(tree.nv), np.ones(tree.nv))


@pytest.mark.parametrize("kind", ["ball", "hinges"])
def test_a_small_inertia_is_no_rounding(kind: str) -> None:
    """Moments 1e-10 of the others, far above rounding, and bodies that are small as a whole."""
    for J, size in (((0.1, 0.1, 1e-11), 1e-11), ((1e-14, 2e-14, 2.5e-14), 1e-14)):
        tree, rng = turned(J, kind).tree(), np.random.default_rng(2)
        for q in rng.standard_normal((10, tree.nq)):
            q = q / np.linalg.norm(q) if kind == "ball" else q
            a = tree.forward_dynamics(q, np.zeros(tree.nv), size * np.ones(tree.nv))
            assert tree.inverse_dynamics(q, np.zeros(tree.nv), a) == pytest.approx(size * np.ones(tree.nv), rel=1e-4)


def test_robots_of_drawn_masses_and_lengths_are_not_refused() -> None:
    """Chains with masses over eight decades, of metres and of millimetres, axes in line among them."""
    rng = np.random.default_rng(4)
    for n in range(20):
        s, unit, parent = mb.Scene("drawn", gravity=(0, 0, -9.81)), 10.0 ** rng.choice([-3, 0]), None
        for k in range(4):
            m, r = 10 ** rng.uniform(-4, 4), unit * 10 ** rng.uniform(-1, 0)
            b = s.rigid_body(f"b{k}", m, tuple(m * r**2 * np.array([0.02, 0.4, 0.41])), at=(unit * (k + 0.5), 0, 0))
            s.revolute(f"j{k}", parent or s.ground, b, at=(unit * k, 0, 0), axis=tuple(np.eye(3)[rng.integers(3)]))
            parent = b
        tree = s.tree()
        q, v = rng.standard_normal((2, 4))
        tau = tree.bias(q, v) + np.diag(tree.mass_matrix(q))
        a = tree.forward_dynamics(q, v, tau)
        assert np.all(np.isfinite(a)), n


def test_masses_too_far_apart_are_named() -> None:
    """A heavy arm on a light one whose hinges are in line: 1e-16 of the inertia decides how the light one accelerates."""
    s = mb.Scene("apart")
    heavy, light = 1e8, 1e-8
    a, b = (s.rigid_body(name, m, (0.1 * m,) * 3, at=(0, 0, 0)) for name, m in (("light", light), ("heavy", heavy)))
    s.revolute("one", s.ground, a, at=(0, 0, 0), axis=(0, 0, 1))
    s.revolute("other", a, b, at=(0, 0, 0), axis=(0, 0, 1))
    with pytest.raises(mb.SceneError, match=r"of masses between 1e-08 and 1e\+08 kg, alike .* masses that differ less"):
        s.tree().forward_dynamics([0.1, 0.2], [0.0, 0.0], [1.0, 1.0])


def test_a_hinge_with_friction_is_a_coordinate() -> None:
    """Dry friction acts in runs; joint-space dynamics know of masses and joints alone."""
    def chain_of(n: int, **friction):
        s, parent = mb.Scene("rubbing", gravity=(0, -9.81, 0)), None
        for k in range(n):
            link = s.link(f"l{k}", (k, 0), (k + 1, 0), mass=1.0)
            s.revolute(f"h{k}", parent or s.ground, link, at=(k, 0), **friction)
            parent = link
        return s

    for n in (1, 3):
        rubbing = chain_of(n, friction=mb.Coulomb(0.1, 1e-3), radius=0.01)
        q = np.linspace(0.1, 0.4, n)
        assert rubbing.tree().mass_matrix(q) == pytest.approx(chain_of(n).tree().mass_matrix(q))
        with pytest.raises(mb.SceneError, match="friction by its reaction"):
            rubbing.write_mjcf("friction.xml")


def test_what_is_no_state_and_no_link_is_named() -> None:
    tree = chain(seed=3).tree()
    with pytest.raises(mb.OptionError, match="no array of real numbers"):
        tree.mass_matrix(tree.zero + 1j)
    with pytest.raises(mb.OptionError, match="the links are"):
        tree.jacobian("nowhere", tree.zero)
    with pytest.raises(ValueError, match="read-only"):
        tree.zero[0] = 1.0
    with pytest.raises(mb.OptionError, match="not the name of a file"):
        chain(seed=3).write_mjcf(None)


def test_coordinates_that_move_the_same_inertia_are_named_together() -> None:
    """Three hinges about z, y, z: in the drawn position the first and the last turn the body alike, elsewhere they do not."""
    s, parent = mb.Scene("wrist", gravity=(0, 0, -9.81)), None
    for name, axis, J in (("a", (0, 0, 1), 0.0), ("b", (0, 1, 0), 0.0), ("c", (0, 0, 1), 1.0)):
        body = s.rigid_body(f"body {name}", J, tuple(J * np.array([0.1, 0.11, 0.12])), at=(0, 0, 0))
        s.revolute(name, parent or s.ground, body, at=(0, 0, 0), axis=axis)
        parent = body
    tree, still = s.tree(), np.zeros(3)
    with pytest.raises(mb.SceneError, match=r"a\.angle, c\.angle: they move the same inertia alike at this q"):
        tree.forward_dynamics([0.3, 0.0, 0.2], still, np.ones(3))
    assert np.all(np.isfinite(tree.forward_dynamics([0.3, 0.5, 0.2], still, np.ones(3))))


def test_velocities_beyond_the_range_are_not_taken_for_missing_inertia() -> None:
    tree = chain(seed=3).tree()
    q, fast = np.linspace(0.1, 0.4, tree.nq), np.full(tree.nv, 1e200)
    with pytest.raises(mb.OptionError, match="beyond the range of numbers at this q"):
        tree.forward_dynamics(q, fast, np.ones(tree.nv))
    with pytest.raises(mb.OptionError, match=r"in state \[1\]"):
        tree.forward_dynamics([q, q], [np.zeros(tree.nv), fast], np.ones(tree.nv))


@pytest.mark.parametrize("seed", [2, 3])
def test_dynamics_do_not_depend_on_how_far_all_has_moved(seed: int) -> None:
    """A slide, or a floating base, that carries all: not a bit changes, as nothing is formed from places in space."""
    s = mb.Scene("far", gravity=(0.3, -1.0, -9.81))
    rng, carrier = np.random.default_rng(seed), s.ground
    for i, kind in enumerate((s.prismatic if seed % 2 else None, s.revolute, s.revolute, s.prismatic)):
        body = s.rigid_body(f"b{i}", 1 + rng.random(), (0.2, 0.25, 0.3), at=rng.normal(size=3))
        if kind is not None:
            kind(f"J{i}", carrier, body, at=rng.normal(size=3), axis=rng.normal(size=3))
        carrier = body
    tree = s.tree()
    q, (v, a) = tree.zero + 0.0, rng.normal(size=(2, tree.nv))
    q[-3:] += rng.normal(size=3)
    far = q.copy()
    far[: 1 if seed % 2 else 3] = 1e10
    tau, at = tree.inverse_dynamics(q, v, a), (0.1, 0.2, 0.3)
    assert np.array_equal(tree.mass_matrix(far), tree.mass_matrix(q))
    assert np.array_equal(tree.inverse_dynamics(far, v, a), tau)
    assert np.array_equal(tree.forward_dynamics(far, v, tau), tree.forward_dynamics(q, v, tau))
    assert np.array_equal(tree.jacobian("b3", far, at), tree.jacobian("b3", q, at))
    assert np.array_equal(tree.jacobian_rate("b3", far, v, at), tree.jacobian_rate("b3", q, v, at))


@pytest.mark.parametrize("x", [1.0, 1e4, 1e8])
def test_a_long_arm_in_closed_form(x: float) -> None:
    """A hinge, a slide that is far out and a pendulum at its end: entries are exact but for rounding of the largest that a
    rotation brings about, eps sqrt(M_ii M_jj), and so are the forces."""
    (m, n), (I, J, K), L = (2.0, 1.5), (0.3, 0.2, 0.1), 0.4
    s = mb.Scene("boom")
    boom, sledge, bob = (s.rigid_body(name, mass, (own,) * 3, at=at) for name, mass, own, at in (
        ("boom", 1.0, I, (0, 0, 0)), ("sledge", m, J, (0, 0, 0)), ("bob", n, K, (L, 0, 0))))
    s.revolute("phi", s.ground, boom, at=(0, 0, 0), axis=(0, 0, 1))
    s.prismatic("x", boom, sledge, at=(0, 0, 0), axis=(1, 0, 0))
    s.revolute("theta", sledge, bob, at=(0, 0, 0), axis=(0, 0, 1))
    tree, phi, theta = s.tree(), 0.7, -0.5
    c, sn = np.cos(theta), np.sin(theta)
    M = np.array([[I + J + K + m * x**2 + n * (x**2 + L**2 + 2 * x * L * c), -n * L * sn, K + n * (L**2 + x * L * c)],
                  [-n * L * sn, m + n, -n * L * sn], [K + n * (L**2 + x * L * c), -n * L * sn, K + n * L**2]])
    (w, u, z), q = (v := np.array([0.3, -0.6, 0.9])), np.array([phi, x, theta])
    along, across, inward = -x * w**2, 2 * u * w, L * (w + z) ** 2  # accelerations without those of the coordinates
    of_bob = along - inward * c, across - inward * sn
    bias = [x * (m * across + n * of_bob[1]) + n * L * (c * of_bob[1] - sn * of_bob[0]), m * along + n * of_bob[0],
            n * L * (c * of_bob[1] - sn * of_bob[0])]
    size = np.sqrt(np.diag(M))
    assert tree.mass_matrix(q) / np.outer(size, size) == pytest.approx(M / np.outer(size, size), abs=1e-15, rel=0)
    assert tree.bias(q, v) / size == pytest.approx(bias / size, abs=1e-15 * x, rel=0)  # of accelerations x w^2
    a = np.array([0.2, -0.3, 0.5])
    found = tree.forward_dynamics(q, v, M @ a + bias)
    assert found == pytest.approx(a, abs=1e-14 * x / L + 1e-14)  # accelerations of the bob, x w^2, over L
