"""Workers of a sweep: processes of their own, or any executor; a worker that dies costs the points it had in hand."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from typing import Any

from mbdae.errors import OptionError
from mbdae.threads import keep_one_thread

DIED = "worker died"
GUARD = ("the worker processes do not start: they import the script again, so keep what it runs under "
         "`if __name__ == '__main__':`")  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What a point came to: its values, or the type and the text of its error; died: its worker ended with it."""

    values: dict[str, Any] | None
    error: str | None = None
    died: bool = False


Job = Callable[..., dict[str, Any]]
Done = Iterator[tuple[int, Outcome]]  #: number of a point and what it came to, as they come


def begin() -> None:
    """Start of a worker process: one BLAS thread; Ctrl-C ends it without a word, the parent reports."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    keep_one_thread()


def ready() -> bool:
    """What a worker answers when it is there."""
    return True


def of_pickle(payload: bytes) -> Outcome:
    """The outcome of a job and point as they were pickled: what cannot be read here is a failure, not a broken worker."""
    try:
        job, point = pickle.loads(payload)
    except Exception as error:
        return Outcome(None, _text(error))
    return outcome(job, point)


def outcome(job: Job, point: dict[str, Any]) -> Outcome:
    """What a point comes to; every error is kept."""
    try:
        values = job(**point)
    except Exception as error:
        return Outcome(None, _text(error))
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        return Outcome(None, f"TypeError: the job returned {values!r}: return a dict of names and values")
    return Outcome(values)


def _text(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def with_processes(job: Job, points: dict[int, dict[str, Any]], workers: int | None) -> Done:
    """Points in processes of their own. When one dies, those in hand at that moment are done again, each alone."""
    payloads = {i: pickle.dumps((job, point)) for i, point in points.items()}
    count = min(workers or os.cpu_count() or 1, len(points))
    waiting = list(payloads)
    while waiting:
        suspects: list[int] = []
        for i, found in _in_pool(payloads, waiting, count):
            if found.died:
                suspects.append(i)
            else:
                yield i, found
        for i in suspects:  # one worker, one point: who dies now has himself to blame
            yield from _in_pool(payloads, [i], 1)


def _in_pool(payloads: dict[int, bytes], waiting: list[int], count: int) -> Done:
    """Points taken from `waiting` until it is empty or a worker dies; no more than one for each worker and one on its way."""
    pool = ProcessPoolExecutor(count, multiprocessing.get_context("spawn"), begin)
    try:
        try:
            pool.submit(ready).result()
        except BrokenExecutor as error:
            raise OptionError(GUARD) from error
        yield from _as_they_come(lambda i: pool.submit(of_pickle, payloads[i]), waiting, count + 1)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)


def with_executor(executor: Executor, job: Job, points: dict[int, dict[str, Any]]) -> Done:
    """Points in an executor that somebody else looks after."""
    waiting = list(points)
    yield from _as_they_come(lambda i: executor.submit(outcome, job, points[i]), waiting, len(waiting))
    for i in waiting:
        yield i, Outcome(None, f"{DIED}: the executor given takes no more points; give a new one, or None for processes", True)


def _as_they_come(submit: Callable[[int], Future[Outcome]], waiting: list[int], most: int) -> Done:
    """Outcomes of points taken from `waiting`, at most so many in hand; stops taking where a worker dies."""
    inside: dict[Future[Outcome], int] = {}
    broken = False
    try:
        while inside or (waiting and not broken):
            while waiting and len(inside) < most and not broken:
                try:
                    inside[submit(waiting[0])] = waiting[0]
                    waiting.pop(0)
                except BrokenExecutor:
                    broken = True
            done, _ = wait(inside, return_when=FIRST_COMPLETED)
            for future in done:
                found = _found(future)
                broken |= _broken(future)
                yield inside.pop(future), found
    finally:
        for future in inside:
            future.cancel()


def _found(future: Future[Outcome]) -> Outcome:
    """The outcome of a future, whatever became of it."""
    try:
        return future.result()
    except (Exception, CancelledError) as error:
        died = isinstance(error, BrokenExecutor | CancelledError) or _killed(error)
        return Outcome(None, f"{DIED}: {_text(error)}" if died else _text(error), died)


def _broken(future: Future[Outcome]) -> bool:
    """Whether the executor went down with it."""
    return not future.cancelled() and isinstance(future.exception(), BrokenExecutor)


def _killed(error: BaseException) -> bool:
    """Whether Dask gave a point up, because so many workers died with it; its scheduler goes on with the others."""
    return type(error).__name__ == "KilledWorker"
