"""Measured claims as plain text, JSON, Markdown and one self-contained HTML page."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import Any

from mbdae.files import write_file
from runner.claim import Claim, Row

COLUMNS = ("case", "solver", "error", "tolerance", "unit", "holds", "CPU s")
STYLE = """body { font: 15px/1.45 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: .6em 0 1.6em } th, td { padding: .15em .8em; text-align: left; vertical-align: top }
th { border-bottom: 1px solid #888 } td:nth-child(3), td:nth-child(4), td:nth-child(7) { text-align: right }
tr.fails { background: #fdd } .origin { color: #555 }"""


@dataclass(frozen=True)
class Measured:
    """A claim with its rows."""

    claim: Claim
    rows: Sequence[Row]

    @property
    def holds(self) -> bool:
        """Whether there are rows and all are within their tolerances."""
        return bool(self.rows) and all(row.met for row in self.rows)

    @property
    def cpu_s(self) -> float:
        """CPU seconds of all runs; several quantities of one run count once."""
        return sum({(row.case.split(":")[0], row.solver): row.cpu_s for row in self.rows}.values())

    def to_dict(self) -> dict[str, object]:
        """For JSON."""
        stated = asdict(self.claim)
        return {"claim": stated.pop("name"), **stated, "holds": self.holds, "cpu_s": self.cpu_s,
                "rows": [row.to_dict() for row in self.rows]}

    @classmethod
    def of(cls, data: dict[str, Any]) -> Measured:
        """What `to_dict` gave."""
        stated = (data[name] for name in ("claim", "statement", "tolerance", "unit", "origin"))
        return cls(Claim(*stated), [Row.of(row) for row in data["rows"]])


def to_dict(measured: Sequence[Measured]) -> dict[str, object]:
    """For JSON."""
    return {"holds": all(m.holds for m in measured), "cpu_s": sum(m.cpu_s for m in measured), "made_with": made_with(),
            "claims": [m.to_dict() for m in measured]}


def text(m: Measured) -> str:
    """One claim for a terminal."""
    lines = [COLUMNS, *(cells(row) for row in m.rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(COLUMNS))]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines]
    heading = f"{m.claim.name}: {'holds' if m.holds else 'DOES NOT HOLD'} ({m.claim.statement})"
    return "\n  ".join([heading, *table, *notes(m)]) + "\n"


def verdict(measured: Sequence[Measured]) -> str:
    """The last line."""
    failed = [m.claim.name for m in measured if not m.holds]
    what = f"{len(failed)} of {len(measured)} do not hold: {', '.join(failed)}" if failed else f"all {len(measured)} hold"
    return f"claims: {what}; {sum(m.cpu_s for m in measured):.1f} s CPU"


def cells(row: Row) -> tuple[str, ...]:
    """One row as texts, in the order of COLUMNS."""
    numbers = (f"{row.error:.2e}", f"{row.tolerance:.0e}" if row.tolerance < 0.01 else f"{row.tolerance:g}")
    return (row.case, row.solver, *numbers, row.unit, "yes" if row.met else "NO", f"{row.cpu_s:.2f}")


def notes(m: Measured) -> list[str]:
    """The remarks of the rows."""
    return [f"{row.case}, {row.solver}: {row.note}" for row in m.rows if row.note]


def made_with() -> str:
    """Versions of the packages the numbers were measured with."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("mbdae", "scikit-sundae", "numpy", "scipy", "symengine"))
    return f"{packages}, Python {platform.python_version()} on {platform.system()} {platform.machine()}"


def write(measured: Sequence[Measured], folder: Path) -> list[Path]:
    """validation.md and validation.html."""
    pages = {"validation.md": markdown(measured), "validation.html": html(measured)}
    for name, content in pages.items():
        write_file(folder / name, content)
    return [folder / name for name in pages]


def markdown(measured: Sequence[Measured]) -> str:
    """Summary, then statement, origin and rows of every claim."""
    lines = ["# Validation", "", f"{verdict(measured)}. Made with {made_with()}."]
    for m in measured:
        lines += ["", f"## {m.claim.name}: {'holds' if m.holds else 'does not hold'}", "", m.claim.statement, "",
                  f"Reference: {m.claim.origin}", "", _line(COLUMNS), _line(["---"] * len(COLUMNS))]
        lines += [_line(cells(row)) for row in m.rows]
        lines += ["", *(f"- {note}" for note in notes(m))] if notes(m) else []
    return "\n".join(lines) + "\n"


def _line(texts: Sequence[str]) -> str:
    return "| " + " | ".join(text.replace("|", "\\|") for text in texts) + " |"


def html(measured: Sequence[Measured]) -> str:
    """The same as one file without references to others."""
    body = [f"<h1>Validation</h1>\n<p>{escape(verdict(measured))}. Made with {escape(made_with())}.</p>"]
    for m in measured:
        rows = "\n".join(_html_row(row) for row in m.rows)
        head = "".join(f"<th>{name}</th>" for name in COLUMNS)
        said = "".join(f"<li>{escape(note)}</li>" for note in notes(m))
        body.append(f"<h2>{escape(m.claim.name)}: {'holds' if m.holds else 'does not hold'}</h2>\n"
                    f"<p>{escape(m.claim.statement)}</p>\n<p class=origin>Reference: {escape(m.claim.origin)}</p>\n"
                    f"<table><tr>{head}</tr>\n{rows}</table>" + (f"\n<ul>{said}</ul>" if said else ""))
    return (f"<!doctype html>\n<html lang=en><meta charset=utf-8><title>Validation of mbdae</title>\n<style>{STYLE}</style>\n"
            + "\n".join(body) + "\n</html>\n")


def _html_row(row: Row) -> str:
    return f"<tr{'' if row.met else ' class=fails'}>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells(row)) + "</tr>"
