"""Progress of a run as a bar on the error stream, if that is a terminal."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbdae.values import function, optional


class Bar:
    """Callback (t, t_end, stats) of a run that draws a progress bar; the bar disappears when the run ends."""

    def __init__(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        console = Console(stderr=True)
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[note]}"))
        self._bar = Progress(*columns, console=console, transient=True, auto_refresh=False, redirect_stdout=False,
                             redirect_stderr=False, disable=not console.is_terminal)  # fmt: skip
        self._task = self._bar.add_task("", total=1.0, note="")
        self._running = False

    def __call__(self, t: float, t_end: float, stats: Any) -> None:
        self.show(t / t_end, "run", f"t = {t:.4g} of {t_end:g} s, {stats.steps} steps, {stats.cpu_s:.1f} s CPU")

    def show(self, share: float, what: str, note: str) -> None:
        """Draw the bar at `share` (0 to 1) of the whole run."""
        if not self._running:
            self._bar.start()
            self._running = True
        self._bar.update(self._task, completed=share, description=what, note=note, refresh=True)

    def close(self) -> None:
        """Remove the bar; the next call of `show` draws it again."""
        if self._running:
            self._bar.stop()
            self._running = False

    def __del__(self) -> None:
        if getattr(self, "_running", False):
            self.close()


def bar() -> Bar:
    """A new progress bar."""
    return Bar()


def progress_of(progress: Any) -> Any:
    """The callback for a progress option: a bar for True, None for False; OptionError for what is no function."""
    if isinstance(progress, bool | np.bool_):
        return bar() if progress else None
    return optional("progress", progress, function, "give True for a bar, a function progress(t, t_end, stats), or None",
                    takes="t, t_end, stats")  # fmt: skip
