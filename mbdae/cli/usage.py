"""The error for wrong usage of the command line, and the endings of reports."""

from __future__ import annotations

REPORTS = (".html", ".md", ".tex")


class UsageError(Exception):
    """Wrong words on the command line, or a file it names that is not as it must be; usage: the words a command takes."""

    def __init__(self, message: str, usage: str = "") -> None:
        super().__init__(message)
        self.usage = usage
