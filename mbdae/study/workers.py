"""Points of a sweep in worker processes, or in any executor. Where a worker process ends, only its present point is lost.

A worker answers one message at a time, and ends when the process that started it ends: a thread of it waits on a handle of its
parent that the operating system signals however the parent ends. While C code holds Python's global lock the thread cannot run;
on Linux the kernel kills the worker even then."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.connection import wait as wait_for
from types import FunctionType
from typing import Any

from mbdae.errors import AccuracyWarning, OptionError
from mbdae.notation import counted
from mbdae.results.reads import reads
from mbdae.threads import SAFE_PATH, keep_one_thread, not_interrupted, safe_path, set_variable

DIED = "worker died"
THREADS = "executor=concurrent.futures.ThreadPoolExecutor()"  #: to work in threads, which share this process's objects


@dataclass(frozen=True)
class Outcome:
    """The outcome of a point: its values, or the type and the text of its error; died: its worker process ended; warnings: the
    texts of AccuracyWarnings of its job."""

    values: dict[str, Any] | None
    error: str | None = None
    died: bool = False
    warnings: tuple[str, ...] = ()


Job = Callable[..., dict[str, Any]]


class Sent:
    """A function that is sent to other processes, where it is called by name: what it reads (constants, helpers, classes) has to
    be there what it is here. told: digests of that by names, see `reads`."""

    def __init__(self, job: Job, told: dict[str, str], same: bool = False) -> None:
        self.job, self.told, self.same = job, told, same

    @classmethod
    def of(cls, job: Job) -> Job:
        """The job as it is sent; itself where it is no function."""
        return cls(job, reads(job), True) if isinstance(job, FunctionType) else job

    def __reduce__(self) -> tuple[Any, ...]:
        return Sent, (self.job, self.told)

    def __call__(self, **point: Any) -> dict[str, Any]:
        if not self.same:
            here = reads(self.job)
            other = [name for name, digest in self.told.items() if here.get(name, digest) != digest]
            if other:
                raise OptionError(f"job: {counted(len(other), 'thing')} that it reads differ in this process from where the "
                                  f"sweep was called ({', '.join(other[:3])}): a process reads them from the file, without what "
                                  "was changed after the import; give what varies as an argument of the job, or pass "
                                  "executor=ThreadPoolExecutor()")
            self.same = True
        return self.job(**point)


Done = Generator[tuple[int, Outcome], None, None]  #: number and outcome of a point, in the order in which they finish


def answer(payload: bytes) -> bytes:
    """The pickled outcome of a pickled (job, point). Where one of these cannot be pickled or unpickled the outcome is a
    failure."""
    try:
        job, point = pickle.loads(payload)
    except Exception as error:
        return pickle.dumps(Outcome(None, _text(error)))
    found = _heard(job, point)
    try:
        return pickle.dumps(found)
    except Exception as error:
        return pickle.dumps(Outcome(None, f"TypeError: the job returned what cannot be sent: {_text(error)}"))


def _heard(job: Job, point: dict[str, Any]) -> Outcome:
    """The outcome of a point with the AccuracyWarnings of its job, which nobody would hear in a worker process; others are
    issued."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", AccuracyWarning)
        found = outcome(job, point)
    for one in caught:
        if not issubclass(one.category, AccuracyWarning):
            warnings.warn_explicit(one.message, one.category, one.filename, one.lineno)
    said = dict.fromkeys(str(one.message) for one in caught if issubclass(one.category, AccuracyWarning))
    return replace(found, warnings=tuple(said))


def outcome(job: Job, point: dict[str, Any]) -> Outcome:
    """The outcome of a point; every error is caught, SystemExit too."""
    try:
        values = job(**point)
    except (Exception, SystemExit) as error:
        return Outcome(None, _text(error))
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        return Outcome(None, f"TypeError: the job returned {values!r}: return a dict of names and values")
    return Outcome(values)


def _text(error: BaseException) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


# -- worker processes


def with_processes(job: Job, points: dict[int, dict[str, Any]], workers: int | None) -> Done:
    """Compute points in worker processes. A point whose worker ends is computed once more by another one; if that ends too, the
    point has failed."""
    job = Sent.of(job)
    payloads = {i: pickle.dumps((job, point)) for i, point in points.items()}
    pool = _Workers(min(workers or os.cpu_count() or 1, len(points)))
    waiting, tried = list(payloads), set[int]()
    try:
        while waiting or pool.busy:
            while waiting and (free := pool.free()) is not None:
                pool.give(free, waiting[0], payloads[waiting[0]])
                del waiting[0]
            for i, found in pool.answers():
                if found.died and i not in tried:
                    tried.add(i)
                    waiting.append(i)
                else:
                    yield i, found
    finally:
        pool.end()


class _Workers:
    """Up to `count` workers, started as they are needed, and the number of the point that each computes."""

    def __init__(self, count: int) -> None:
        self.count = count
        self.idle: list[Worker] = []
        self.busy: dict[Connection, tuple[Worker, int]] = {}
        self._begun = False

    def free(self) -> Worker | None:
        """A worker without a point, a new one where there may be more; None where all are busy."""
        if self.idle:
            return self.idle.pop()
        if len(self.busy) >= self.count:
            return None
        worker = Worker(answer)
        if not self._begun:  # wait for the first one: an error that prevents workers from starting is then printed once
            self._wait_for_first(worker)
        return worker

    def _wait_for_first(self, worker: Worker) -> None:
        try:
            worker.wait_until_ready()
        except WorkerDiedError as error:
            if error.code >= 0:
                told = ("so keep what it runs under `if __name__ == '__main__':`" if error.code == UNGUARDED else
                        "and end; their messages are printed above")
                raise OptionError(f"the worker processes do not start: they import the script again, {told}") from None
            raise OptionError(f"the worker processes do not start: {error}; to work in threads instead, pass {THREADS}") from None
        except BaseException:
            worker.kill()
            raise
        self._begun = True

    def give(self, worker: Worker, i: int, payload: bytes) -> None:
        """Send point number i to a worker; where the worker has ended in the meantime, `answers` reports it."""
        self.busy[worker.connection] = worker, i
        worker.send(payload)

    def answers(self) -> Done:
        """Outcomes that have arrived; waits for at least one message."""
        for connection in wait_for(list(self.busy)):
            worker, i = self.busy[connection]  # type: ignore[index]
            try:
                found = worker.receive()
            except WorkerDiedError as error:
                found = Outcome(None, f"{DIED}: {error}", True)
            else:
                if found is None:  # the message says that the worker has started, and is no answer
                    continue
                self.idle.append(worker)
            del self.busy[connection]  # type: ignore[arg-type]
            yield i, found

    def end(self) -> None:
        """Kill all workers."""
        for worker in [*self.idle, *(worker for worker, _ in self.busy.values())]:
            worker.kill()


# -- an executor that the user gives


def with_executor(executor: Executor, job: Job, points: dict[int, dict[str, Any]]) -> Done:
    """Compute points in an executor, which the user has started and will end. What its futures raise is its own error, as where
    Dask loses a result with a worker, since `outcome` catches those of jobs: such a point is computed once more."""
    job, waiting, tried, broken = Sent.of(job), list(points), set[int](), False
    inside: dict[Future[Outcome], int] = {}
    try:
        while inside or (waiting and not broken):
            while waiting and not broken:
                try:
                    inside[executor.submit(outcome, job, points[waiting[0]])] = waiting[0]
                    del waiting[0]
                except BrokenExecutor:
                    broken = True
            for future in wait(inside, return_when=FIRST_COMPLETED).done:
                found, i, raised = _found(future), inside.pop(future), not future.cancelled() and future.exception()
                broken |= isinstance(raised, BrokenExecutor)
                if raised and not found.died and i not in tried:
                    tried.add(i)
                    waiting.append(i)
                else:
                    yield i, found
    finally:
        for future in inside:
            future.cancel()
    for i in waiting:
        yield i, Outcome(None, f"{DIED}: the executor given takes no more points; give a new one, or None for processes", True)


def _found(future: Future[Outcome]) -> Outcome:
    """The outcome of a future, also where it was cancelled or its executor broke."""
    try:
        return future.result()
    except (Exception, CancelledError) as error:
        died = isinstance(error, BrokenExecutor | CancelledError) or type(error).__name__ == "KilledWorker"  # Dask gave it up
        return Outcome(None, f"{DIED}: {_text(error)}" if died else _text(error), died)


READY = b""
NAME = "mbdae-worker"  #: of worker processes
UNGUARDED = 75  #: exit code of a worker that would start workers while it imports the script, before it has begun to serve
_SERVING: list[bool] = []  #: not empty in a worker that has begun
PR_SET_PDEATHSIG = 1  #: of prctl(2): the signal a process gets when the thread that started it ends
LOOK = 1.0  #: time (s) between two checks whether the parent process still runs, in case its end does not signal its handle


class WorkerDiedError(Exception):
    """A worker process ended before it answered; code: with which it ended itself, negative where a signal killed it."""

    def __init__(self, code: int) -> None:
        super().__init__(_ended(code))
        self.code = code


class Worker:
    """One process that answers messages (bytes) by `answer`, a function at the top level of a module."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        if multiprocessing.current_process().name == NAME and not _SERVING:
            raise SystemExit(UNGUARDED)
        context = multiprocessing.get_context("spawn")
        self.connection, theirs = context.Pipe()
        safe = os.environ.get(SAFE_PATH)
        self._process = context.Process(target=_serve, name=NAME, args=(theirs, answer, os.getpid(), safe))
        with safe_path(), not_interrupted():
            self._process.start()
        theirs.close()

    def wait_until_ready(self) -> None:
        """Wait until the process has begun; WorkerDiedError where it ended before."""
        self._received()

    def send(self, message: bytes) -> None:
        """Send a message; where the worker has died, `receive` raises the error."""
        with suppress(OSError):
            self.connection.send_bytes(message)

    def receive(self) -> Any:
        """The next answer, unpickled; None where the worker says that it has begun. WorkerDiedError where it has ended."""
        data = self._received()
        return pickle.loads(data) if data != READY else None

    def _received(self) -> bytes:
        try:
            return self.connection.recv_bytes()
        except (EOFError, OSError):
            self._process.join()
            code = self._process.exitcode or 0
            self.connection.close()
            raise WorkerDiedError(code) from None

    def kill(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.join()
        self.connection.close()


def _ended(code: int) -> str:
    """How a process ended, in words."""
    if code >= 0:
        return f"its process ended itself with exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    memory = ", as the system does where memory runs out" if name == "SIGKILL" else ""
    return f"its process was killed by {name}{memory}"


def _serve(connection: Connection, answer: Callable[[bytes], bytes], parent: int, safe_path: str | None) -> None:
    """The main loop of a worker."""
    _SERVING.append(True)
    _die_with(parent)
    set_variable(SAFE_PATH, safe_path)
    signal.signal(signal.SIGINT, lambda *_: None)  # Ctrl-C reaches all processes; it is the parent that ends workers
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
    keep_one_thread()
    connection.send_bytes(READY)
    with suppress(EOFError, OSError):
        while True:
            connection.send_bytes(answer(connection.recv_bytes()))


def _die_with(parent: int) -> None:
    """End this process as soon as its parent has ended."""
    process = multiprocessing.parent_process()
    assert process is not None

    def watch() -> None:
        while not wait_for([process.sentinel], LOOK):
            if hasattr(os, "getppid") and os.getppid() != parent and sys.platform != "win32":
                break
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    if sys.platform == "linux":
        with suppress(OSError, AttributeError):
            ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(1)
