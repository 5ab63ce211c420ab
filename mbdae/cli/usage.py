"""The error for wrong usage of the command line, and the suffixes of reports."""

from __future__ import annotations

REPORTS = (".html", ".md", ".tex")


class UsageError(Exception):
    """Wrong words on the command line, or an unusable file among them; usage: the words that the command takes."""

    def __init__(self, message: str, usage: str = "") -> None:
        super().__init__(message)
        self.usage = usage
