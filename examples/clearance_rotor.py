r"""A flexible rotor that turns with play in one of its bearings.

A steel tube of 6 m, 45 to 50 mm thick, carries a rigid disk in the middle, whose centre of mass lies e = 1 mm off the axis. At
R a revolute turns it at the constant speed Omega = 24 rad/s in a bearing on springs; at T a pin of radius rho_l = 80 mm, the
shaft's end, runs with the clearance c = rho_k - rho_l = 0.8 mm in a race of 2 kg, which hangs on springs too. Both bearings
are anisotropic, 2e5 N/m along y and 1e5 N/m along z, with dampers of 200 N s/m. There is no gravity and everything starts
undeformed, without whirl.

Where the pin reaches d - c = a > 0 into the race, d being the distance of the centres, Hertz contact with damping presses

    f_n = k a^(3/2) (1 + lambda a'),     k = 1e9 N/m^1.5, lambda = 0.3 s/m,

and friction drags f_t = mu f_n along the race against the sliding velocity, which is nearly Omega rho_l = 1.92 m/s. The
unbalance throws the pin against the race after 0.07 s; from then on it rolls around in it at about the speed of the rotor, at
most c and the deepest indentation, 0.06 mm, off its centre. Omega lies between the two lowest critical speeds of the anisotropic
bearings, 22.5 and 24.6 rad/s without play, so that the whirl grows for seconds and turns back and forth.

Options: `friction` "coulomb" (mu = 0.3 tanh(v / 0.01 m/s)), "lugre", None or a law; `clearance` c, None for an ideal
joint; `stiffness` k and `damping` lambda of the contact; `bearing` and `bearing_damping`, the springs along y and z and the
dampers; `eccentricity` e; `speed` Omega; `elements` of the shaft, their `order` and `section`. The problem is from
"Modified models for revolute joints coupling flexibility of links in multibody systems" ("the paper"), which takes shaft and
disk from elsewhere and gives neither k nor the friction; those above are ours.

Sliding at 1.9 m/s cannot tell Coulomb's law from LuGre's: bristles that slide so fast are bent by mu_k / sigma0 = 3 micrometres
and stay so, and both laws give mu = 0.3. Their orbits differ by less than the tolerance of the run, which is printed. What
tells them apart is slow motion from rest: see stick_slip.py.

Run it:  mbdae run examples/clearance_rotor.py --out out
Draw it: python examples/clearance_rotor.py out   (rotor, orbits of pin and disk, friction force and coefficient: Figs. 10-12)
"""

import sys
from pathlib import Path

import numpy as np

import mbdae as mb

LENGTH, PIN, CLEARANCE = 6.0, 0.08, 8e-4  # m
TUBE = mb.Section.tube(outer=0.05, inner=0.045, E=210e9, nu=0.3, rho=7800.0)
DISK, DISK_INERTIA, ECCENTRICITY = 70.573, (2.0325024, 1.0309539, 1.0309539), 1e-3  # kg, kg m^2, m
RACE, RACE_INERTIA = 2.0, (2e-3, 1e-3, 1e-3)  # kg, kg m^2
BEARING, BEARING_DAMPING = (2e5, 1e5), 200.0  # N/m along y and z, N s/m
OMEGA = 24.0  # rad/s
STIFFNESS, DAMPING = 1e9, 0.3  # N/m^1.5, s/m
LAWS = {"coulomb": mb.Coulomb(mu=0.3, v_c=0.01), "lugre": mb.LuGre(mu_k=0.3, mu_s=0.3, v_s=0.01, sigma0=1e5, sigma1=250.0)}

t_end = 2.0  # s
measure = "T.penetration"


def scene(friction="coulomb", clearance=CLEARANCE, stiffness=STIFFNESS, damping=DAMPING, bearing=BEARING,
          bearing_damping=BEARING_DAMPING, eccentricity=ECCENTRICITY, speed=OMEGA, elements=6, order=2,
          section=TUBE):
    """Shaft along x from R to T, the disk in its middle. Housings are held against turning about the shaft by a stiff spring;
    they may tilt. The pin spins in the race from the start."""
    s = mb.Scene(f"clearance rotor, friction {friction}" if clearance is not None else "rotor in ideal bearings")
    R, middle, T = (0, 0, 0), (LENGTH / 2, 0, 0), (LENGTH, 0, 0)
    s.rigid_body("housing", 0.0, (0, 0, 0), at=R)
    shaft = s.beam("shaft", R, T, section=section, elements=elements, order=order, axis2=(0, 1, 0))
    disk = s.rigid_body("disk", DISK, DISK_INERTIA, at=(LENGTH / 2, eccentricity, 0))
    s.weld("mount", shaft, disk, at=middle)
    race = s.rigid_body("race", RACE, RACE_INERTIA, at=T)
    for end, body, at, along in (("R", "housing", R, 1e7), ("T", race, T, 0.0)):
        springs, dampers = (along, *bearing, 1e6, 0, 0), (200.0 if along else 0.0, bearing_damping, bearing_damping, 1e3, 0, 0)
        s.bushing("bearing " + end, s.ground, body, at=at, stiffness=springs, damping=dampers)
    s.revolute("R", "housing", shaft, at=R, axis=(1, 0, 0), angle=speed * mb.t)
    model = None
    if clearance is not None:
        law = LAWS[friction] if isinstance(friction, str) else friction
        model = mb.Clearance(outer=PIN + clearance, inner=PIN, normal=mb.Hertz(stiffness, damping), friction=law)
    s.revolute("T", race, shaft, at=T, axis=(1, 0, 0), rate0=speed, model=model)
    return s


def orbit(r):
    """Centre of the pin relative to that of the race (nt, 2), m, along y and z."""
    pin, race = r[r.prepared.model.scene["shaft"].at(1.0)].position, r["race"].position
    return (pin - race)[:, 1:]


def agreement(coulomb, lugre):
    """Largest distance (m) of the orbits with the two laws."""
    return float(np.max(np.linalg.norm(orbit(coulomb) - orbit(lugre), axis=1)))


def pictures(out, accuracy=1e-4, t_end=t_end, solver=None, **options):
    """Our own versions of the paper's Figs. 10-12, as .png files in a folder: the rotor; the paths of pin and disk; friction
    force over time; friction coefficient over sliding velocity."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    scene(**options).draw(folder / "rotor.png")
    runs = {name: scene(name, **options).simulate(t_end, accuracy, solver) for name in LAWS}
    runs = {name: r(np.linspace(0.0, t_end, 20001)) for name, r in runs.items()}
    _draw_orbits(runs, options.get("clearance", CLEARANCE), folder / "orbits.png")
    _draw_friction(runs, folder / "friction_force.png")
    _draw_coefficient(runs, folder / "friction_coefficient.png")
    return tuple(runs.values())


LINES = {"coulomb": {"label": "Coulomb", "color": "#0072B2", "linewidth": 1.6},
         "lugre": {"label": "LuGre", "color": "#D55E00", "linewidth": 1.0, "dashes": (4, 3)}}


def _figure(rows, columns, size):
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for a in axes:
        a.grid(True, color="0.9")
        a.set_axisbelow(True)
        a.spines[["top", "right"]].set_visible(False)
    return figure, axes


def _draw_orbits(runs, clearance, path):
    figure, (pin, disk) = _figure(1, 2, (9.0, 4.8))
    angle = np.linspace(0, 2 * np.pi, 200)
    pin.plot(1e3 * clearance * np.cos(angle), 1e3 * clearance * np.sin(angle), color="0.4", linewidth=2.5, label="clearance")
    for name, r in runs.items():
        pin.plot(*(1e3 * orbit(r).T), **LINES[name])
        disk.plot(*(1e3 * r["disk"].position[:, 1:].T), **LINES[name])
    for axis, what in ((pin, "centre of the pin in the race"), (disk, "centre of mass of the disk")):
        axis.set(title=what, xlabel="y [mm]", ylabel="z [mm]")
        axis.set_aspect("equal", "box")
    figure.legend(*pin.get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    figure.savefig(path, dpi=150)


def _draw_friction(runs, path):
    """Friction force over the whole run and after the first touch, and the difference of the laws."""
    figure, (whole, first, difference) = _figure(3, 1, (8.0, 7.2))
    begin = next(iter(runs.values()))["T"].contacts.first
    near = np.linspace(begin - 2e-3, begin + 0.03, 2001)
    for name, r in runs.items():
        whole.plot(r.t, r["T"].friction_force, **LINES[name])
        first.plot(near, r(near)["T"].friction_force, **LINES[name])
    coulomb, lugre = runs.values()
    difference.plot(coulomb.t, lugre["T"].friction_force - coulomb["T"].friction_force, color="black", linewidth=0.7)
    for axis, label in ((whole, "friction force [N]"), (first, "friction force [N]"), (difference, "LuGre - Coulomb [N]")):
        axis.set_ylabel(label)
    difference.set_xlabel("time [s]")
    whole.legend(fontsize=8)
    figure.savefig(path, dpi=150)


def _draw_coefficient(runs, path):
    """Friction coefficient of steady sliding with both laws, and the sliding velocities of the rotor in contact."""
    figure, (axis,) = _figure(1, 1, (6.5, 3.6))
    speed, coulomb, lugre = np.geomspace(1e-4, 3, 400), LAWS["coulomb"], LAWS["lugre"]
    axis.plot(speed, coulomb.mu * np.tanh(speed / coulomb.v_c), **LINES["coulomb"])
    fall = lugre.mu_k + (lugre.mu_s - lugre.mu_k) * np.exp(-((speed / lugre.v_s) ** 2))
    axis.plot(speed, fall, **LINES["lugre"])
    slip = np.concatenate([np.abs(r["T"].slip[r["T"].normal_force > 0]) for r in runs.values()])
    axis.axvspan(slip.min(), slip.max(), color="0.75", label="rotor in contact")
    axis.set(xscale="log", xlabel="sliding velocity [m/s]", ylabel="friction coefficient [-]", ylim=(0, 0.35))
    axis.legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    coulomb, lugre = pictures(sys.argv[1] if len(sys.argv) > 1 else "out")
    print(coulomb, lugre, sep="\n")
    print(f"largest radius of the orbit {1e3 * np.max(np.linalg.norm(orbit(coulomb), axis=1)):.4f} mm, deepest penetration "
          f"{1e6 * coulomb['T'].contacts.deepest:.1f} micrometres")
    known = coulomb.accuracy.estimated * coulomb.prepared.length
    print(f"orbits with Coulomb's and LuGre's law differ by {agreement(coulomb, lugre):.1e} m, the error of a run is estimated "
          f"at {known:.1e} m: sliding this fast, the laws cannot be told apart; see stick_slip.py")
