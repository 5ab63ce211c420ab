"""Plots of sensors, readable in grey prints and by colour-blind readers, with units on all axes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.errors import OptionError, SceneError
from mbdae.files import replacing
from mbdae.notation import counted
from mbdae.results.result import Result
from mbdae.scene.components import Body, Connection, Place
from mbdae.scene.sensed import measured, placed, split
from mbdae.values import Array, file_to_write, of_class, option, sequence, shown, text

#: colours of Okabe and Ito by falling contrast; the line style changes with the colour, for grey prints
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)), (0, (1, 1)))
#: SECTION: components of beam strains and stress resultants; PANELS: first letter of the components that one panel shows, name
#: of their quantity, unit
SECTION = {"strain": ["Γ1", "Γ2", "Γ3", "K1", "K2", "K3"], "stress_resultants": ["N1", "N2", "N3", "M1", "M2", "M3"]}
PANELS = {"strain": (("Γ", "strain", "-"), ("K", "curvature", "1/m")),
          "stress_resultants": (("N", "section force", "N"), ("M", "section moment", "N m"))}
BAND = 0.25  #: opacity of the band of the error of a plotted quantity
WIDTH = 100  #: largest number of letters in one line of a legend
PLACE = "name a body, a joint, a position sensor or a place such as body.at(point)"
PICTURES = (".png", ".svg", ".pdf")


def new_figure(rows: int, width: float = 7.0, height: float = 2.4, ax: Any = None) -> tuple[Any, list[Any]]:
    """A figure with `rows` axes one below the other, or axes that the user has given, with their figure; matplotlib's backend is
    left as it is."""
    from mbdae.show import Figure

    if ax is None:
        figure = Figure(figsize=(width, 0.6 + height * rows), layout="constrained")
        axes = list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    else:
        axes = given_axes(ax, rows)
        figure = axes[0].figure
    for a in axes:
        dress(a)
    return figure, axes


def given_axes(ax: Any, count: int, spatial: bool = False) -> list[Any]:
    """The axes that were given to draw in; OptionError for another number of them, or where a picture in space is to be drawn on
    axes in the plane, or the other way round."""
    from matplotlib.axes import Axes

    kind = "axes of matplotlib in space, subplot_kw={'projection': '3d'}" if spatial else "axes of matplotlib in the plane"
    wanted = f"give {kind}" if count == 1 else f"give a list of {count} {kind}, one for each panel"
    found = [ax] if isinstance(ax, Axes) else list(np.ravel(np.array(ax, dtype=object)))
    if len(found) != count or not all(isinstance(one, Axes) and (one.name == "3d") == spatial for one in found):
        raise OptionError(f"ax = {shown(ax)} cannot be drawn in: {wanted}")
    return found


def dress(axis: Any) -> None:
    """Give axes a light grid and whole numbers at their ticks, and remove the frame."""
    for side in (axis.xaxis, axis.yaxis):  # not "+1.6e-2" at the end of the axis, to be added by the reader
        getattr(side.get_major_formatter(), "set_useOffset", bool)(False)
    axis.grid(True, color="0.9")
    axis.set_axisbelow(True)
    axis.spines[["top", "right"]].set_visible(False)


def steady(axis: Any) -> None:
    """Widen the limits of axes whose values differ only by round-off, so that their ticks are readable."""
    low, high = axis.dataLim.intervaly
    size = max(abs(low), abs(high))
    if high - low < 1e-9 * size:
        axis.set_ylim((low + high) / 2 - 0.1 * size, (low + high) / 2 + 0.1 * size)


def style(i: int) -> dict[str, Any]:
    """Colour and line style of the i-th line; the first 49 pairs are different."""
    n = len(COLOURS)
    return {"color": COLOURS[i % n], "linestyle": STYLES[(i + i // n) % len(STYLES)], "linewidth": 1.4}


def checked(path: Any, suffixes: Sequence[str] = PICTURES, what: str = "plot") -> Path:
    """The checked path to write to; OptionError for an unknown suffix or a folder that cannot be used."""
    known = ", ".join(suffixes[:-1]) + f" or {suffixes[-1]}"
    file: Path = option("path", path, file_to_write, f"{what} writes {known} into a folder that exists", suffixes=suffixes)
    return file


def hexadecimal(colour: Any) -> str:
    """A colour as "#rrggbb"; ValueError where matplotlib does not know it."""
    from matplotlib.colors import to_hex

    return str(to_hex(colour))


def names_of(what: str, given: Any) -> list[str]:
    """Names of items from one item or a list of them."""
    names: list[str] = option(what, [given] if isinstance(given, str | Body | Connection) else given, sequence,
                              "give the name of an item, or a list of them", each=_name)
    return names


def _name(value: Any) -> str:
    return value.name if isinstance(value, Body | Connection) else str(text(value))


def written(figure: Any, path: Any, what: str = "plot") -> Any:
    """The figure, saved where a path is given."""
    if path is not None:
        with replacing(checked(path, what=what)) as part:
            figure.savefig(part, dpi=150)
    return figure


# ---- reading sensors ---------------------------------------------------------------------------------------------------


def numbers(result: Any, sensor: str) -> Array:
    """Values (nt, n) of a sensor; SceneError where there is none of that name, OptionError where it is not numeric."""
    values = result.read(sensor)
    if values.dtype.kind not in "fi" or values.shape[:1] != result.t.shape:
        raise OptionError(f"'{sensor}' is not a quantity over time; plot a sensor with numbers at every time, such as the "
                          f"position of a body or the angle of a joint")
    return np.asarray(values.reshape(len(values), -1), dtype=float)


def components(result: Any, sensor: str) -> list[tuple[str, Array]]:
    """(component, values (nt,)) of a sensor: "x", "y", "z" for vectors, "" for scalars, "N1" to "M3" for sections of beams; in a
    planar model only those in the plane."""
    values, quantity = numbers(result, sensor), split(sensor)[1]
    pair = ["x", "y"] if quantity == "orbit" else ["near end", "far end"]
    count = values.shape[1]
    known = {1: [""], 2: pair, 3: list("xyz"), 9: [a + b for a in "xyz" for b in "xyz"]}
    names = SECTION.get(quantity) or known.get(count) or [str(i) for i in range(count)]
    shown = names
    if result.prepared.model.planar and quantity in SECTION:
        shown = [names[i] for i in ((0, 2, 4) if np.any(values[:, [2, 4]]) else (0, 1, 5))]
    elif result.prepared.model.planar and len(names) == 3:
        shown = ["z"] if quantity in ("angular_velocity", "torque") else ["x", "y"]
    elif result.prepared.model.planar and len(names) == 9:
        shown = ["xx", "xy", "yx", "yy"]
    return [(name, values[:, names.index(name)]) for name in shown]


def strips(result: Any, sensor: str) -> list[tuple[str, list[tuple[str, Array]]]]:
    """For every panel in which a sensor is drawn: label with unit, and components."""
    parts, known = components(result, sensor), PANELS.get(split(sensor)[1], ())
    split_up = [(f"{sensor} [{unit}]", [p for p in parts if p[0].startswith(letter)]) for letter, _, unit in known]
    return split_up or [(label_of(result, sensor), parts)]


def label_of(result: Any, sensor: str) -> str:
    """A sensor's name with its unit."""
    return with_unit(sensor, measured(result.prepared.model.scene, sensor)[1])


def with_unit(name: str, unit: str) -> str:
    """A name with its unit, [-] where there is none."""
    return f"{name} [{unit or '-'}]"


def track(result: Any, place: Any) -> tuple[str, Array]:
    """Name and path (nt, 3), m, of a place: a Place, or the name of a body, of a joint, of a place such as "beam.at(0.5)", or
    of a position sensor."""
    if isinstance(place, Place):
        at = ", ".join(f"{x:g}" for x in place.point[: 2 if result.prepared.model.planar else 3])
        return f"{place.body.name} at ({at})", np.asarray(result[place].position)
    path = place.name if isinstance(place, Body | Connection) else option("place", place, text, PLACE)
    name, quantity = split(path) if "." in path else (path, "position")
    quantity = quantity or "position"
    try:
        item = placed(result.prepared.model.scene, name)[0]
    except SceneError as error:
        raise SceneError([f"there is no place {shown(place)}: {'; '.join(error.problems)}"]) from error
    if isinstance(item, Connection) and quantity == "position":
        return name, np.asarray(result[Place(item.l, item.joint.point_on("l"))].position)
    if quantity != "position":
        raise OptionError(f"'{place}' is not a place; name a body, a joint, '{name}.position' or a place such as body.at(point)")
    return name, np.asarray(result.read(f"{name}.position"))


def compared(result: Any, against: Any, labels: Sequence[str] | None) -> list[tuple[str, Any]]:
    """(label, result) of a result and those compared with it; without labels they are named by scene or solver."""
    given = [] if against is None else against if isinstance(against, list | tuple) else [against]
    others = option("against", given, sequence, "give a Result, or a list of them", each=of_class, base=Result)
    results = [result, *others]
    if labels is None:
        return list(zip(_different_names(results) if others else [""], results, strict=True))
    one_each = f"give {counted(len(results), 'text')}, one for each result, this one first"
    texts = option("labels", labels, sequence, one_each, each=text)
    if len(texts) != len(results):
        raise OptionError(f"labels = {shown(labels)} has {counted(len(texts), 'entry')} for "
                          f"{counted(len(results), 'result')}: {one_each}")
    return list(zip(texts, results, strict=True))


def _different_names(results: list[Any]) -> list[str]:
    solvers = [f"{r.info.solver.label} {r.info.form}" for r in results]
    for names in ([r.prepared.model.scene.name for r in results], solvers):
        if len(set(names)) == len(names):
            return names
    return [f"{i + 1}: {name}" for i, name in enumerate(solvers)]


# ---- pictures ----------------------------------------------------------------------------------------------------------


def plot_results(result: Result, sensors: Sequence[str], against: Any, labels: Sequence[str] | None, path: Any,
                 ax: Any = None) -> Any:
    """Implements `Result.plot`: one panel per quantity; sensors of the same quantity share it, vectors show their components."""
    results = compared(result, against, labels)
    place = checked(path) if path is not None else None
    if not sensors:
        raise OptionError("plot: name at least one sensor, e.g. r.plot('C.angle')")
    first, panels = results[0][1], dict[tuple[str, str], list[str]]()
    for sensor in sensors:
        numbers(first, sensor)
        known = [(letter, with_unit(name, unit)) for letter, name, unit in PANELS.get(split(sensor)[1], ())]
        for panel in known or [("", with_unit(*measured(first.prepared.model.scene, sensor)))]:
            panels.setdefault(panel, []).append(sensor)
    figure, axes = new_figure(len(panels), ax=ax)
    for axis, ((letter, label), names) in zip(axes, panels.items(), strict=True):
        _panel(axis, results, names, letter)
        axis.set_ylabel(label)
        _legend(axis)
    axes[-1].set_xlabel("time [s]")
    return written(figure, place)


def _panel(axis: Any, results: Sequence[tuple[str, Any]], sensors: Sequence[str], letter: str) -> None:
    for sensor in sensors:
        for label, result in results:
            error = result.error(sensor)
            for component, values in components(result, sensor):
                if not component.startswith(letter):
                    continue
                name = " ".join(part for part in (sensor, component, f"({label})" if label else "") if part)
                (line,) = axis.plot(result.t, values, label=name, **style(len(axis.lines)))
                if error is not None and np.isfinite(error):  # a band, seen where it is wider than the line
                    axis.fill_between(result.t, values - error, values + error, color=line.get_color(), alpha=BAND, linewidth=0)
    steady(axis)


def _legend(axis: Any) -> None:
    if len(axis.lines) > 1:
        longest = max(len(str(line.get_label())) for line in axis.lines)
        columns = max(1, min(3 if len(axis.lines) % 3 == 0 else 2, WIDTH // (longest + 6)))
        axis.legend(frameon=False, fontsize="small", ncols=columns, loc="lower left", bbox_to_anchor=(0, 1), borderaxespad=0.2)
    else:
        axis.set_title(axis.lines[0].get_label(), fontsize="medium", loc="left")


def plot_phase(result: Result, x: str, y: str, against: Any, labels: Sequence[str] | None, path: Any, ax: Any = None) -> Any:
    """Implements `Result.phase`: one sensor over another; components of vectors in pairs."""
    results = compared(result, against, labels)
    place = checked(path, what="phase") if path is not None else None
    figure, (axis,) = new_figure(1, 6.0, 4.2, ax)
    for label, result in results:
        across, up = components(result, x), components(result, y)
        if len(across) != len(up) and 1 not in (len(across), len(up)):
            raise OptionError(f"phase: '{x}' has {counted(len(across), 'component')} and '{y}' has {len(up)}; give "
                              f"two sensors of equal number of components, or one with a single component")
        n = max(len(across), len(up))
        for (cx, a), (cy, b) in zip(across * (n // len(across)), up * (n // len(up)), strict=True):
            part = "" if n == 1 else cx if cx == cy else f"{cx}{cy}"
            _path(axis, a, b, " ".join(p for p in (part, label) if p) or None)
    first = results[0][1]
    _frame(axis, label_of(first, x), label_of(first, y))
    return written(figure, place, "phase")


def plot_orbit(result: Result, place: Any, axes: str, against: Any, labels: Sequence[str] | None, path: Any,
               ax: Any = None) -> Any:
    """Implements `Result.orbit`: path of a place projected on a plane of two axes, equal scales, m."""
    results = compared(result, against, labels)
    if not (isinstance(axes, str) and len(axes) == 2 and axes[0] != axes[1] and set(axes) <= set("xyz")):
        raise OptionError(f"axes = {shown(axes)} is not a plane: give two of x, y and z, such as 'xy'")
    file = checked(path, what="orbit") if path is not None else None
    figure, (axis,) = new_figure(1, 6.0, 4.8, ax)
    i, j = "xyz".index(axes[0]), "xyz".index(axes[1])
    for label, result in results:
        name, r = track(result, place)
        _path(axis, r[:, i], r[:, j], label or None)
    axis.set_aspect("equal", "datalim")
    _frame(axis, f"{name} {axes[0]} [m]", f"{name} {axes[1]} [m]")
    return written(figure, file, "orbit")


def plot_branch(branch: Any, sensor: str | None, path: Any, ax: Any = None) -> Any:
    """Implements `Branch.plot`: one value per point over the number, solid where stable; rings where located."""
    file = checked(path, what="plot") if path is not None else None
    largest = np.array([np.max(np.abs(roots), initial=0.0) for roots in branch.roots])
    height = largest if sensor is None else branch.peaks(sensor)
    figure, (axis,) = new_figure(1, 6.0, 4.2, ax)
    x, stable = branch.values, np.array([one is True for one in branch.stable])
    for k in range(len(x) - 1):
        axis.plot(x[k : k + 2], height[k : k + 2], "-" if stable[k] and stable[k + 1] else "--", color=style(0)["color"])
    for one in branch.located:
        k = int(np.argmin(np.abs(x - one.value)))
        axis.plot(one.value, height[k], "o", color=style(1)["color"], markerfacecolor="white")
        axis.annotate(one.kind, (one.value, height[k]), textcoords="offset points", xytext=(5, 5), fontsize="small")
    axis.set_xlabel(branch.name)
    axis.set_ylabel("largest multiplier or root" if sensor is None else f"peak of {sensor}")
    return written(figure, file, "plot")


def _path(axis: Any, x: Array, y: Array, label: str | None) -> None:
    """Draw a line with its start (ring) and end (square) marked."""
    look = style(len(axis.lines) // 3)
    axis.plot(x, y, label=label, **look)
    for k, marker, face in ((0, "o", "white"), (-1, "s", look["color"])):
        axis.plot(x[k], y[k], marker, color=look["color"], markerfacecolor=face, markersize=6.5, markeredgewidth=1.5)


def _frame(axis: Any, x: str, y: str) -> None:
    from matplotlib.lines import Line2D

    handles = [line for line in axis.lines if not line.get_label().startswith("_")]
    handles += [Line2D([], [], color="0.3", marker=m, markerfacecolor=f, linestyle="", label=text)
                for m, f, text in (("o", "white", "start"), ("s", "0.3", "end"))]
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.legend(handles=handles, frameon=False, fontsize="small", ncols=4, loc="lower left", bbox_to_anchor=(0, 1))
