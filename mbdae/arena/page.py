"""An arena as data, tables, pictures and one HTML page, in light and dark.

Performance profiles are those of Dolan and More: the share of the scenes that a program brings below an error at a CPU time of at
most so many times that of the best one. Diagrams of work and precision are those of Hairer and Wanner: error over CPU time, one
line a method.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from mbdae.compare.page import Comparison, inline_svg, ticks
from mbdae.compare.table import Row
from mbdae.engines import CANNOT, OTHER
from mbdae.errors import OptionError
from mbdae.files import write_file
from mbdae.notation import counted
from mbdae.show import Figure
from mbdae.show.plots import given_axes
from mbdae.study import Study, bullets, document, grid, headings, html_row, html_table, made_with, section
from mbdae.values import option, path, shown

Compared = Sequence[tuple[str, Comparison]]
LEVELS = (1e-3, 1e-5)  #: errors at which costs are compared
SILENT = 3.0  #: a run silently misses what was asked of it where its error is more than so many times that, and it did not fail
LARGEST = 1000.0  #: largest ratio of CPU times in a profile
COLOURS = {"mbdae": "#0072B2", "scipy": "#D55E00", "exudyn": "#009E73", "mujoco": "#CC79A7"}
FURTHER = ("#E69F00", "#56B4E9", "#882255", "#999933")
STYLE = """
.scenes { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(26rem, 100%), 1fr)); gap: 1rem 1.5rem; }
.missed :is(th, td):last-child, .stays :is(th, td):is(:nth-child(2), :last-child) { text-align: left; }
.scenes h3 { font-size: 1rem; margin: .5rem 0 0; } .scenes figure { margin: .25rem 0; } .scenes details { font-size: .875rem; }
"""


@dataclass(frozen=True)
class Entry:
    """One scene of an arena. suite: its class; comparison: None where there is none, for the reason in `error`; hashes: SHA-256
    of its statements, and of its exported equations in C where these can be exported."""

    name: str
    suite: str
    comparison: Comparison | None
    error: str
    hashes: dict[str, str]


@dataclass(frozen=True)
class Arena(Study):
    """Many scenes, each compared; made by `mb.arena`."""

    entries: tuple[Entry, ...]
    asked: dict[str, Any]  #: what it was asked for, as plain data
    environment: dict[str, str | int]

    kind = "arena"

    @property
    def comparisons(self) -> list[tuple[str, Comparison]]:
        """Scenes that were compared, by name."""
        return [(entry.name, entry.comparison) for entry in self.entries if entry.comparison is not None]

    def to_dict(self) -> dict[str, Any]:
        """All data as dictionaries, lists, texts and numbers; values that are not known are None."""
        entries = [{"name": e.name, "suite": e.suite, "error": e.error, "hashes": e.hashes,
                    "comparison": e.comparison.to_dict() if e.comparison else None} for e in self.entries]
        data = {"asked": self.asked, "programs": programs(self.comparisons), "missed": missed(self.comparisons),
                "stays": stays(self.comparisons), "entries": entries, "environment": self.environment}
        return dict(json.loads(json.dumps(data)))

    def table(self) -> str:
        """Programs side by side, what was silently missed by whom, and where errors stay, as plain text."""
        parts = [f"{self.scene}: {len(self.comparisons)} of {counted(len(self.entries), 'scene')} compared", ""]
        for rows in (programs(self.comparisons), missed(self.comparisons), stays(self.comparisons)):
            if rows:
                parts += [*grid([tuple(rows[0]), *(tuple(map(str, row.values())) for row in rows)]), ""]
        parts += [f"{e.name}: {e.error}" for e in self.entries if e.error]
        return "\n".join(parts).rstrip()

    def _page(self) -> str:
        return page(self)

    def plot(self, ax: Any = None) -> Any:
        """Performance profiles of the programs, as a matplotlib figure. ax: axes of matplotlib to draw in, one for each level."""
        return figure(self.comparisons, ax=ax)

    def save(self, folder: Any) -> Path:
        """Write the arena into a folder, which may be new: index.html, arena.json with all data, summary.txt, environment.json,
        CITATION.cff and the scenes. Returns the folder; OptionError where it cannot be written."""
        where = Path(option("folder", folder, path, "give a folder"))
        try:
            (where / "scenes").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise OptionError(f"folder = {shown(folder)} cannot be made: {error.strerror or error}; name another one") from error
        data = json.dumps(self.to_dict(), indent=1, allow_nan=False) + "\n"
        texts = {"arena.json": data, "index.html": self._page(), "summary.txt": self.table() + "\n",
                 "environment.json": json.dumps(self.environment | {"asked": self.asked}, indent=1) + "\n",
                 "CITATION.cff": citation(self, hashlib.sha256(data.encode()).hexdigest())}
        texts |= {f"scenes/{file_name(e.name)}.json": e.comparison.to_json() for e in self.entries if e.comparison is not None}
        for name, text in texts.items():
            write_file(where / name, text)
        return where

    def __repr__(self) -> str:
        return f"<Arena of {len(self.entries)} scenes; print it for the tables, .save(folder) for the page>"


def citation(a: Arena, digest: str) -> str:
    """A CITATION.cff of the folder."""
    own = (f"{name} {value}" for name, value in a.environment.items() if name not in ("machine", "cpus"))
    versions = ", ".join(dict.fromkeys([*a.asked["engines"], *own]))
    return (f'cff-version: 1.2.0\nmessage: "If you use these data, cite them as below."\ntype: dataset\ntitle: "{a.scene}"\n'
            f'authors:\n  - name: "mbdae"\nversion: "{a.environment["mbdae"]}"\n'
            f'abstract: "{len(a.entries)} scenes by several multibody programs against confirmed references; {versions}."\n'
            f'identifiers:\n  - type: other\n    value: "sha256:{digest}"\n    description: "arena.json"\n')


def file_name(name: str) -> str:
    """The name of a scene as that of a file, without an ending."""
    return "".join(c if c.isalnum() else "-" for c in name.lower()).strip("-") or "scene"


# -- what the comparisons say together


def program(row: Row) -> str:
    """The program of a row."""
    return row.engine.split(" ")[0] if row.engine else "mbdae"


def method(row: Row) -> str:
    """The method of a row, alike in all scenes."""
    if row.engine:
        return f"{program(row)} {row.solver}".strip()
    model = f", {row.model.split(' (')[0].lower()}" if row.model else ""
    return "mbdae simulate" if row.chosen else f"mbdae {row.solver}{model}"


def programs(comparisons: Compared) -> list[dict[str, Any]]:
    """A row for each program: scenes that it states, scenes that it brings below the levels and its CPU time over that of the
    best."""
    names = list(dict.fromkeys(program(row) for _, w in comparisons for row in w.runs))
    found = []
    for name in names:
        stated = [w for _, w in comparisons if any(program(row) == name and row.measured is not None for row in w.runs)]
        row: dict[str, Any] = {"program": name, "scenes stated": f"{len(stated)} of {len(comparisons)}"}
        for level in LEVELS:
            ratios = profiles(comparisons, level, program).get(name, [])
            middle = f"{np.median(ratios):.2g}" if ratios else "-"
            row |= {f"below {level:.0e}": len(ratios), f"CPU over best, {level:.0e}": middle}
        found.append(row)
    return found


def asked(row: Row) -> float | None:
    """The accuracy or tolerance that a run was asked for; None where it has a step."""
    return row.accuracy if not row.engine else row.rtol if row.setting.startswith("rtol") else None


def missed(comparisons: Compared) -> list[dict[str, Any]]:
    """Methods that were asked for an accuracy or a tolerance and silently missed it, the worst first."""
    found = dict[str, list[tuple[float, str]]]()
    counts = dict[str, int]()
    for name, w in comparisons:
        known = w.reference.difference or 0.0
        for row in w.runs:
            wanted = asked(row)
            if wanted is None or row.measured is None or row.error is None or row.loose or row.told or known > wanted:
                continue
            counts[method(row)] = counts.get(method(row), 0) + 1
            if row.error > SILENT * (wanted + known):
                found.setdefault(method(row), []).append((row.error / wanted, f"{name} at {wanted:.0e}"))
    order = sorted(found, key=lambda one: -max(found[one])[0])
    return [{"method": one, "silently missed": f"{len(found[one])} of {counts[one]}", "worst, times": _times(max(found[one])[0]),
             "where": max(found[one])[1]} for one in order]


def _times(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 100 else f"{ratio:.2g}"


def stays(comparisons: Compared) -> list[dict[str, Any]]:
    """Ladders of programs whose error does not become smaller, with the reason where one is known."""
    return [{"scene": name, "method": one.label, "error stays at": f"{one.floor:.1e}", "why": one.why}
            for name, w in comparisons for one in w.converged if one.floor is not None and one.why]


def profiles(comparisons: Compared, level: float, by: Any) -> dict[str, list[float]]:
    """For each program or method (`by` of a row) the CPU times over that of the best one, of the scenes that it brings below an
    error."""
    found = dict[str, list[float]]()
    for _, w in comparisons:
        costs = dict[str, float]()
        for row in w.runs:
            if row.measured is not None and not (row.loose or row.chosen) and row.measured[0] <= level:
                costs[by(row)] = min(costs.get(by(row), np.inf), row.measured[1])
        for name, cost in costs.items():
            found.setdefault(name, []).append(cost / min(costs.values()))
    return {name: sorted(ratios) for name, ratios in found.items()}


# -- pictures


def colour(name: str, names: Sequence[str]) -> str:
    """The colour of a program."""
    others = [one for one in names if one not in COLOURS]
    return COLOURS.get(name) or FURTHER[others.index(name) % len(FURTHER)]


def figure(comparisons: Compared, stacked: bool = False, ax: Any = None) -> Any:
    """Performance profiles of the programs at the levels, side by side or stacked, or on axes that are given."""
    if ax is None:
        made = Figure(figsize=(4.2, 6.4) if stacked else (9.0, 3.4), layout="constrained")
        axes = made.subplots(len(LEVELS), 1) if stacked else made.subplots(1, len(LEVELS), sharey=True)
    else:
        axes = given_axes(ax, len(LEVELS))
    for axis, level in zip(axes, LEVELS, strict=True):
        found = profiles(comparisons, level, program)
        for name, ratios in sorted(found.items()):
            inside = [ratio for ratio in ratios if ratio <= LARGEST]
            x, y = [1.0, *inside, LARGEST], np.r_[0, np.arange(1, len(inside) + 1), len(inside)] / max(1, len(comparisons))
            axis.step(x, y, where="post", color=colour(name, [*found]), label=name, linewidth=2)
        axis.set(xscale="log", xlim=(1, LARGEST), ylim=(0, 1.02), xlabel="CPU time over that of the best program")
        axis.set_title(f"error below {level:.0e}", fontsize="medium")
        axis.grid(True, color="0.9")
        axis.spines[["top", "right"]].set_visible(False)
    for axis in axes if stacked else axes[:1]:
        axis.set_ylabel("share of the scenes")
    handles = {label: line for axis in axes for line, label in zip(*axis.get_legend_handles_labels(), strict=True)}
    if ax is not None:
        axes[-1].legend(handles.values(), handles, frameon=False)
        return axes[0].figure
    made.legend(handles.values(), handles, loc="outside lower center", ncols=2 if stacked else 4, frameon=False)
    return made


def work(w: Comparison) -> Any:
    """Error over CPU time of every method, in the colour of its program."""
    made = Figure(figsize=(4.6, 3.4), layout="constrained")
    axis = made.subplots()
    names = list(dict.fromkeys(program(row) for row in w.runs))
    told = set[str]()
    for label in dict.fromkeys(row.label for row in w.runs):
        rows = [row for row in w.runs if row.label == label and row.measured is not None and row.error and not row.loose]
        points = [(1e3 * (row.cpu_s or 0.0), row.error or 0.0) for row in rows]
        if points:
            name = program(rows[0])
            axis.loglog(*zip(*points, strict=True), marker="o", markersize=3, linewidth=1, color=colour(name, names),
                        label="_" if name in told else name)
            told.add(name)
    if w.reference.difference and (low := axis.get_ylim()[0]) < w.reference.difference:
        axis.axhspan(low, w.reference.difference, color="0.5", alpha=0.2, linewidth=0, zorder=0)
        axis.set_ylim(bottom=low)
    ticks(axis)
    axis.set(xlabel="CPU time [ms]", ylabel="error of the motion")
    axis.grid(True, color="0.9")
    axis.spines[["top", "right"]].set_visible(False)
    made.legend(frameon=False, fontsize="small", loc="outside lower center", ncols=4)
    return made


# -- the page


NOTES = {
    "programs": ("Programs", "Of each program the cheapest of its methods and settings counts. below: scenes brought below an "
                 "error; CPU over best: the median of these scenes."),
    "missed": ("Silently missed", f"Runs that ended as if they had done what they were asked for, with an error of more than "
               f"{SILENT:g} times that. A step is no accuracy that is asked for; runs asked for more than the reference resolves "
               f"are not counted. Single runs, of mbdae too, do not estimate the error of their motion; 'mbdae simulate' does."),
    "stays": ("Errors that stay", "Smaller steps or tolerances do not help there."),
    "scenes": ("Scenes", "One line is a method of a program, from loose to tight settings; errors in the grey are below the "
               "uncertainty of the reference. Error: ")}


def page(a: Arena) -> str:
    """The HTML page of an arena."""
    done = a.comparisons
    title = f"Performance profiles of {counted(len(programs(done)), 'program')} on {counted(len(done), 'scene')}"
    parts = [f"<p>{counted(len(done), 'scene')} of {len(a.entries)}, each by several programs against a reference that a second "
             f"method has confirmed. Errors are those of the motion of the bodies; CPU times those of the solvers alone, on one "
             f"thread.</p>\n"]
    if done:
        wide, narrow = (inline_svg(figure(done, stacked), title, name) for stacked, name in ((False, "wide"), (True, "narrow")))
        parts.append(section("profiles", "Performance profiles", f'<figure><div class="wide">{wide}</div>'
                             f'<div class="narrow">{narrow}</div></figure>\n'))
    for key, rows in (("programs", programs(done)), ("missed", missed(done)), ("stays", stays(done))):
        if rows:
            cells = [html_row(str(first), [f"<td>{escape(str(value))}</td>" for value in rest])
                     for first, *rest in (row.values() for row in rows)]
            table = html_table(key, headings(tuple(rows[0])), cells, kind=key)
            parts.append(section(key, NOTES[key][0], f'{table}<p class="note">{escape(NOTES[key][1])}</p>\n'))
    scenes = "".join(_scene(n, *pair) for n, pair in enumerate(done))
    if done:
        note = f'<p class="note">{escape(NOTES["scenes"][1] + done[0][1].what)}.</p>\n'
        parts.append(section("scenes", NOTES["scenes"][0], f'{note}<div class="scenes">{scenes}</div>\n'))
    if failed := [f"{e.name}: {e.error}" for e in a.entries if e.error]:
        parts.append(section("failed", "Not compared", bullets(failed)))
    hashes = [html_row(e.name, [f"<td>{escape(e.hashes.get(of, '-')[:12])}</td>" for of in ("statements", "equations")])
              for e in a.entries]
    parts.append(section("hashes", "Hashes", html_table("hashes", headings(("scene", "statements", "equations in C")), hashes)
                         + '<p class="note">First digits of SHA-256; whole ones are in arena.json.</p>\n'))
    others = {"programs": ", ".join(a.asked["engines"])} if a.asked["engines"] else {}
    parts.append(made_with(f"{sum(w.total_cpu_s for _, w in done):.0f} s", others | a.environment))
    return document(a.scene, STYLE, parts)


def _scene(number: int, name: str, w: Comparison) -> str:
    """Picture and words of one scene."""
    said = list(dict.fromkeys((row.engine, row.failure or "") for row in w.failures if row.engine))
    without = "".join(f"; {engine} cannot state it" for engine, why in said if why.startswith(CANNOT))
    shown = bullets([f"{engine}: {why}" for engine, why in said if why.startswith(OTHER)])
    title = escape(f"Work and precision on {name}, to t = {w.t_end:g} s")
    return (f"<article><h3>{escape(name)}, to {w.t_end:g} s</h3><figure>{inline_svg(work(w), title, f's{number}')}</figure>"
            f"<details><summary>{counted(len(w.runs), 'run')}; reference to {w.reference.difference or 0.0:.0e}{escape(without)}"
            f"</summary><p>{escape(w.decision)}</p></details>{shown if OTHER in shown else ''}</article>\n")
