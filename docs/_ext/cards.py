"""Cards of the gallery: what each shows and teaches, and the moving picture of its mechanism.

A card is a file of examples/ with run(), number(run) -> (found, expected) or (found, expected, error), and picture(run). A new
one is such a file, a line here, and one in the list of pages of docs/gallery.md; `tests/test_docs.py` holds it to the rest.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

FRAMES, PAUSE = 48, 80  #: of a moving picture; ms from one to the next
SIZE, DPI = (4.0, 3.0), 80  #: inch; pixels an inch
PALETTE, ROOM = 48, 1.12  #: number of colours; size of the picture over that of what moves in it


@dataclass(frozen=True)
class Card:
    """Title and lesson of an example, and how its mechanism is shown. of: the result that is shown, from what run() returns;
    hide: items that are left out; trail: places whose path is drawn; follow: the body that stays in the middle; span: part of the
    time that is shown, s; turn: azimuth of the view of a scene in space, deg."""

    title: str
    lesson: str
    of: Callable[[Any], Any] = lambda run: run
    hide: Sequence[str] = ()
    trail: Sequence[str] = ()
    follow: str = ""
    span: tuple[float, float] | None = None
    turn: float = -55.0


GALLERY: dict[str, dict[str, Card]] = {
    "Mechanisms": {
        "four_bar": Card("Four-bar", "A loop closes by itself, and the forces of its drive follow."),
        "strandbeest": Card("Strandbeest", "Two legs of thirteen lengths each: paths are those of circles that meet.",
                            trail=["left foot.position", "right foot.position"]),
        "flapping_wing": Card("Flapping wing", "Fourteen links and two cranks, for which one statement of a scene is enough."),
        "over_constrained_loop": Card("Over-constrained loop",
                                      "A loop with more constraints than freedoms still moves, where rank tells."),
        "gearbox_torques": Card("Planetary gear", "Gears couple angles; torques of a table, kinks and all, drive them."),
        "andrews_squeezer": Card("Squeezing mechanism", "Seven bodies within 30 ms: the published benchmark to nine digits."),
        "screw": Card("A joint of your own", "State a motion in one line: rows, forces and sensors follow.", span=(0.0, 0.4)),
        "crane": Card("Crane", "A run ends at an event, the next one goes on with other joints.", of=lambda run: run[1]),
        "hook_block": Card("Hook block", "A rope over four pulleys and a drum pulls, and never pushes."),
    },
    "Bodies in space, and what rolls": {
        "gyroscope": Card("Gyroscope", "Energy and angular momentum alone tell how far it dips.", hide=["fork"]),
        "heavy_top": Card("Heavy top", "Joint models, forms and solvers side by side on the benchmark.", trail=["top"]),
        "tennis_racket": Card("Wing nut", "Spun about its intermediate axis it turns over; an elliptic integral says when."),
        "satellite": Card("Satellite", "From MJCF: an arm goes round, and the hull has turned without any torque from outside."),
        "rolling_coin": Card("Rolling coin", "Rolling restricts velocities, not places; the reactions follow.", trail=["coin"],
                             hide=["edge"]),
        "bicycle": Card("Bicycle", "The benchmark bicycle is stable by itself; its roots are the published ones.", follow="frame",
                        turn=-35.0, hide=["rear_tyre", "front_tyre", "rear_hub", "front_hub", "steer"]),
        "tippe_top": Card("Tippe top", "Friction turns it over, and keeps Jellett's constant."),
    },
    "Contact, clearance, friction": {
        "newtons_cradle": Card("Newton's cradle", "Contacts without loss pass on all they have got."),
        "bouncing_ball": Card("Bouncing ball", "Restitution of Hertz' contact with damping, and friction until it rolls."),
        "ball_over_cylinder": Card("Ball over a cylinder", "Where it leaves is where the normal force ends."),
        "latched_door": Card("Door with a latch", "A stop, a rebound and a latch, each a contact."),
        "slider_crank_clearance": Card("Slider-crank with clearance", "Play at two pins is more than the sum of the single ones.",
                                       of=lambda run: run["BC"][0]),
        "clearance_forces": Card("Joint forces by clearance", "What a wider race does to the force, impact by impact."),
        "stick_slip": Card("Stick-slip", "Two laws of friction beside each other, one of them with a memory.",
                           of=lambda run: run["lugre"]),
        "door_closer": Card("Door closer, fitted", "Spring, damper and dry friction from measurements, with their errors.",
                            of=lambda run: run.result),
    },
    "Flexible bodies": {
        "engine_rod": Card("Elastic connecting rod", "A relaxed start has the peak of steady running at once."),
        "turbine_blade": Card("Blade of finite elements", "A mesh becomes a body of a few modes, which stiffens as it turns."),
        "whirling_shaft": Card("Whirling shaft", "A state at rest in a turning frame, near the critical speed.",
                               of=lambda run: importlib.import_module("whirling_shaft").scene().simulate(0.05, accuracy=1e-4)),
        "snap_through": Card("Snapping arch", "States at rest are followed around the fold; the load there has an error."),
    },
    "Robots and control": {
        "arm_control": Card("Robot arm", "Computed torque makes its error decay as a linear equation says."),
        "urdf_arm": Card("Arm from URDF", "A file becomes a scene, and its tree has the equations of the textbook."),
        "robot_arm": Card("Inverse dynamics", "Torques along a path, by the tree in one call, and by drives in a run."),
        "exported_equations": Card("Exported equations", "The same right-hand side in SymPy, integrated by SciPy."),
    },
    "Stability, derivatives": {
        "ground_resonance": Card("Rotor in ground resonance", "Floquet multipliers of what no frozen instant tells."),
        "kapitza": Card("Kapitza's pendulum", "It stands on its head as long as its pivot is shaken."),
        "trebuchet": Card("Trebuchet", "The derivative of the throw by every mass and place, from one run."),
        "quarter_car": Card("Suspension", "A measured road, whose every kink a step meets."),
        "suspension_design": Card("Suspension for a road", "Spring and damper between comfort, grip and room, by derivatives.",
                                  of=lambda run: run.result),
        "lightest_four_bar": Card("The lightest four-bar", "Counterweights under a bound on a torque, beside a linear program.",
                                  of=lambda run: run.result),
        "crane_scipy": Card("A crane that leaves no swing", "The scene as a function with a Jacobian, for SciPy, torch and jax."),
        "ground_resonance_boundary": Card("Boundary of ground resonance", "The gradient of one root says which damper moves it.",
                                          of=lambda run: importlib.import_module("ground_resonance").run()),
    },
}
CARDS = {name: card for group in GALLERY.values() for name, card in group.items()}


def moving(card: Card, run: Any, file: Path) -> None:
    """Write the mechanism in motion as a GIF, and its middle picture beside it as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    from mbdae.show.animation import common_palette
    from mbdae.show.drawing import Picture, axes_for
    from mbdae.show.shapes import filmed

    result = card.of(run)
    begin, end = card.span or (result.t[0], result.t[-1])
    film = filmed(result, np.linspace(begin, end, FRAMES), (), card.trail, 1.0, card.hide)
    seen = followed(film.seen, card.follow) if card.follow else film.seen
    figure = Figure(figsize=SIZE, dpi=DPI)
    canvas = FigureCanvasAgg(figure)
    axes = axes_for(figure, seen, figure.add_gridspec(1, 1)[0])
    axes.set_axis_off()
    picture = Picture(axes, seen)
    trails = [picture.trail(trail.points, trail.colour) for trail in film.trails]
    framed(axes, card, seen, [trail.points for trail in film.trails])
    frames = []
    for i in range(FRAMES):
        picture.show(i)
        for lengthen in trails:
            lengthen(i * film.fine)
        canvas.draw()
        frames.append(Image.fromarray(np.array(canvas.buffer_rgba())[:, :, :3]))
    palette = common_palette(frames[:: FRAMES // 6], PALETTE)
    drawn = [frame.quantize(palette=palette, dither=0) for frame in frames]
    drawn[0].save(file.with_suffix(".gif"), save_all=True, append_images=drawn[1:], duration=PAUSE, loop=0)
    drawn[FRAMES // 2].save(file.with_suffix(".png"), optimize=True)


def framed(axes: Any, card: Card, seen: Any, more: Sequence[Any]) -> None:
    """Limits of axes that fill the whole figure, so that everything but grids is in the picture at all times."""
    shapes = [shape for shape in seen.shapes if shape.kind != "grid"] or seen.shapes
    points = np.vstack([*(seen.polyline(shape).reshape(-1, 3) for shape in shapes), *more])
    share = SIZE[1] / SIZE[0]
    if seen.planar:
        axes.set_aspect("auto")
        axes.set_position((0, 0, 1, 1))
        across, tall = points[:, 0], points[:, 1]
    else:  # axes in space are square: as wide as the figure, above and below it what is left over
        axes.view_init(elev=axes.elev, azim=card.turn, vertical_axis="xyz"[axes._vertical_axis])
        axes.set_position((0, (1 - 1 / share) / 2, 1, 1 / share))
        there = np.c_[points, np.ones(len(points))] @ axes.get_proj().T
        (across, tall), share = (there[:, :2] / there[:, 3:]).T, 1.0
    middle = np.array([np.min(across) + np.max(across), np.min(tall) + np.max(tall)]) / 2
    half = ROOM / 2 * max(float(np.ptp(across)), float(np.ptp(tall)) * SIZE[0] / SIZE[1])
    limits = [(c - h, c + h) for c, h in zip(middle, (half, half * share), strict=True)]
    if seen.planar:
        axes.set(xlim=limits[0], ylim=limits[1])
    else:
        axes.viewLim.intervalx, axes.viewLim.intervaly = limits


def followed(seen: Any, name: str) -> Any:
    """A geometry as seen by somebody who moves along with a body, and does not turn."""
    away = seen.poses[name].position - seen.poses[name].position[0]
    poses = {body: replace(pose, position=pose.position - away) for body, pose in seen.poses.items()}
    shapes = tuple(shape if shape.body else replace(shape, points=shape.points - away[:, None]) for shape in seen.shapes)
    return replace(seen, poses=poses, shapes=shapes)


def said(example: Any, found: Sequence[float]) -> str:
    """The number of a card with its error, and what was expected."""
    value, expected, *error = found
    what = (example.number.__doc__ or "").splitlines()[0].rstrip(".").partition(";")[0]
    return f"{what}: {value:.7g}{f' ± {error[0]:.1g}' if error else ''}, expected {expected:.7g}"
