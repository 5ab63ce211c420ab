"""What `mbdae report paper` and `mbdae report FILE.audit` do."""

from __future__ import annotations

from pathlib import Path

from mbdae.audit.page import Audit, audit, audit_paper
from mbdae.errors import OptionError

FORMATS = ("html", "md", "tex")


def report_audit(source: str, format: str | None = None, out: str | None = None) -> tuple[Audit, str, str | None]:
    """An audit, its text (a table, or the document in a format) and the file it was written to, if any.

    source: "paper", or a file of printed formulas; out: a file, or a folder that gets `paper.html` and the like."""
    found = audit_paper() if source == "paper" else audit(Path(source))
    if out is None:
        document = found.document()
        writers = {"html": document.to_html, "md": document.to_markdown, "tex": document.to_latex, None: found.table}
        return found, writers[format](), None
    path = Path(out)
    if path.suffix.lstrip(".") not in FORMATS:
        path = path / f"{Path(source).stem}.{format or 'html'}"
    elif format is not None and path.suffix != f".{format}":
        raise OptionError(f"--out {out} ends with {path.suffix}, --format says {format}: leave one of them out")
    path.parent.mkdir(parents=True, exist_ok=True)
    return found, found.table(), str(found.save(path))
