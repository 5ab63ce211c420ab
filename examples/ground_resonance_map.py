r"""Ground resonance over rotor speed and lag damping: where a rotor shakes itself to pieces, and who can tell.

Four blades (rods of length L and mass m) lag about hinges at the distance e from a hub that turns at Omega on a block on
springs; c is the damping of a lag hinge. For small lags zeta_i and displacements x of the hub,

    M(t) z'' + C(t) z' + K(t) z = 0,  z = (x, zeta),  with the period T = 2 pi / Omega:

blades act on the hub along directions that turn. Two changes of coordinates make the coefficients constant. Coleman's, to
multiblade coordinates a = 2/N sum zeta_i cos(psi_i), b = 2/N sum zeta_i sin(psi_i), ... in the frame of the ground, asks for
equal blades, on any support. The frame of the hub, `s.linearize(frame="hub")`, asks for a support that is the same in all
directions, with any blades. Where blades differ *and* the support does, both fail, and only the multipliers of one period
tell: x(T) = Phi x(0), growth max log|eig Phi| / T, `s.floquet(T)`.

The picture has both. On the left, a support with equal springs along x and y and equal dampers: the boundary of stability by
`linearize` in the hub's frame (line) and by `floquet` (dots) is the same. On the right, a support along x only, and the
damper of blade 1 has failed: the boundary by `floquet`, and that of four equal blades with the mean damping 3/4 c, which
is all that Coleman's transformation could be asked about. In between the mean says stable, and the rotor is lost: at 21 rad/s
and c = 2000 N m s the mean rotor decays as exp(-0.33 t), the real one grows as exp(0.69 t): the blade without a damper does not
care how strong the other dampers are.

Run it:  mbdae run examples/ground_resonance_map.py
         python examples/ground_resonance_map.py out       (the map, half a minute of CPU; goes on where it was stopped)
"""

import sys
from pathlib import Path

import numpy as np

import mbdae as mb

BLADES, L, M, HINGE = 4, 4.25, 12.75, 0.25  # -, m, kg, m
BLOCK, STIFFNESS, DAMPING = 30.0, 12000.0, 150.0  # kg, N/m, N s/m
GRID = {"speed": np.linspace(8, 32, 9), "damper": np.linspace(250, 4000, 7)}  # rad/s, N m s

t_end = 1.0  # s
measure = "lag 1.angle"


def scene(speed=20.01, dampers=(400.0,) * BLADES, isotropic=True, lag0=0.0, damping=DAMPING):
    """Block, hub and blades; the block on a bushing, or on a slide along x."""
    s = mb.Scene("ground resonance with lag dampers")
    block = s.rigid_body("block", BLOCK, 1.0, at=(0, 0))
    if isotropic:
        s.fixed_orientation("level", s.ground, block)
        s.bushing("support", s.ground, block, (0, 0), (STIFFNESS, STIFFNESS, 0), (damping, damping, 0))
    else:
        s.prismatic("support", s.ground, block, at=(0, 0), axis=(1, 0, 0), spring=STIFFNESS, damper=damping)
    hub = s.rigid_body("hub", 0.0, 0.0, at=(0, 0))
    s.revolute("shaft", block, hub, at=(0, 0), angle=speed * mb.t)
    for i, damper in enumerate(dampers):
        direction = np.round([np.cos(i * np.pi / 2), np.sin(i * np.pi / 2)])
        root = HINGE * direction
        blade = s.link(f"blade {i + 1}", root, root + L * direction, mass=M)
        s.revolute(f"lag {i + 1}", hub, blade, at=root, damper=damper, angle0=lag0 if i == 0 else 0.0)
    return s if isotropic else s.recursive()  # an ordinary differential equation is cheaper


def growth(speed, damper):
    """Growth rates (1/s) at a point of the map: isotropic support with equal dampers by both ways, and on one axis with the
    damper of blade 1 failed, and with the mean of the dampers on all blades."""
    period, rotor = 2 * np.pi / speed, scene(speed, (damper,) * BLADES)
    failed, mean = (0.0, *(damper,) * (BLADES - 1)), (0.75 * damper,) * BLADES
    return {"linearize": rotor.linearize(frame="hub").growth.max(), "floquet": rotor.floquet(period).growth.max(),
            "failed": scene(speed, failed, isotropic=False).floquet(period).growth.max(),
            "mean": scene(speed, mean, isotropic=False).floquet(period).growth.max()}


def picture(found, grid, path):
    """Growth as colour, boundaries of stability as lines."""
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, 2, figsize=(11, 4.5), sharey=True, layout="constrained")
    for ax, title, shown, style, other, color, label in (
        (axes[0], "equal dampers, support along x and y", "floquet", ":", "linearize", "gold", "linearize in the hub's frame"),
        (axes[1], "damper of blade 1 failed, support along x", "failed", "-", "mean", "green", "equal blades, mean damping"),
    ):
        filled = ax.contourf(*grid.values(), found.array(shown).T, np.linspace(-3, 3, 25), cmap="RdBu_r", extend="both")
        ax.contour(*grid.values(), found.array(other).T, [0], colors=color)
        ax.contour(*grid.values(), found.array(shown).T, [0], colors="k", linestyles=style, linewidths=3)
        ax.plot([], [], "k" + style, lw=3, label="floquet")
        ax.plot([], [], color, label=label)
        ax.set(title=title, xlabel="rotor speed [rad/s]")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    axes[0].set_ylabel("lag damper [N m s]")
    fig.colorbar(filled, ax=axes, label="largest growth rate [1/s]")
    fig.savefig(path, dpi=120)
    plt.close(fig)


def main(out, grid=GRID):
    """The map as a picture in a folder; its rows are kept beside it."""
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    found = mb.sweep(growth, grid, resume=folder / "ground_resonance_map.jsonl", progress=lambda n, of: print(n, "of", of))
    picture(found, grid, folder / "ground_resonance_map.png")
    return found


if __name__ == "__main__":
    print(main(sys.argv[1] if len(sys.argv) > 1 else "out"))
