"""What is wrong usage of the command line, and the endings of reports."""

from __future__ import annotations

REPORTS = (".html", ".md", ".tex")


class UsageError(Exception):
    """The command line, or the file it names, is not as it must be. usage: the words a command takes, where they are wrong."""

    def __init__(self, message: str, usage: str = "") -> None:
        super().__init__(message)
        self.usage = usage
