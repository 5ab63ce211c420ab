"""Prints 0 where a process works that is forked a time (s, argument) after another thread began to import and derive."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

import mbdae as mb


def end() -> float:
    """The end of a rod that falls, m."""
    s = mb.Scene("rod", gravity=(0, -9.81, 0))
    s.revolute("A", s.ground, s.link("rod", (0, 0), (1, 0), mass=1.0), at=(0, 0), model=mb.Kinematic())
    return float(s.simulate(0.1)["rod"].position[-1, 1])


found: list[float] = []
thread = threading.Thread(target=lambda: found.append(end()))
thread.start()
time.sleep(float(sys.argv[1]))
child = os.fork()
if child == 0:
    signal.alarm(60)
    answer = 1
    try:
        answer = 0 if abs(end()) < 1 else 3
    finally:
        os._exit(answer)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
thread.join()
print(code if found else "the thread failed")
