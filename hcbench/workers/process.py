"""Runs an engine in a process that hcbench owns, never in the user's.

Some engines keep settings in globals of the process (PyBullet does), some print, some crash. So their work
is done in one worker process that is started when first needed and kept. Code that already runs in a
process of hcbench's own, such as a pool's worker, says so with `enter_worker` and works in place.

The worker is a fresh interpreter: the user's main module is not run again in it, so scripts need no
`if __name__ == "__main__"` for it. Functions and values cross by pickle, functions by their module's name.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any, TypeVar

from hcbench.errors import EngineFailed
from hcbench.workers.main import Answer, receive, send, serve

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Result = TypeVar("Result")
Item = TypeVar("Item")

_START_S = 60.0  # for a new interpreter to come up on a busy machine
_GIVE_UP = 3  # deaths in a row, nothing done in between


class WorkerDied(EngineFailed):
    """The worker crashed or hung. `done` holds what it had delivered until then."""

    def __init__(self, slot: str, got: str, expected: str, todo: str = "", done: Sequence[Any] = ()) -> None:
        super().__init__(slot, got, expected, todo)
        self.done = list(done)


_inside = False


def enter_worker() -> None:
    """Declare this process to be hcbench's own: engines then run in it, in place.

    To be called first thing in a process, for instance as the initializer of a pool. Interrupts are left
    to the parent from then on: on Ctrl-C the terminal sends one to every process, and the parent decides.
    """
    global _inside  # noqa: PLW0603 - a fact about the process
    _inside = True
    with suppress(ValueError):  # not the main thread: then interrupts do not come here anyway
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def in_worker() -> bool:
    """Whether this process is hcbench's own."""
    return _inside


@contextmanager
def quiet() -> Iterator[None]:
    """Nothing that C code prints gets out; for hcbench's own processes, as it concerns all threads."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [(fd, os.dup(fd)) for fd in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for fd, _ in kept:
            os.dup2(nowhere, fd)
        yield
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        with suppress(OSError, TypeError, AttributeError):  # C keeps a buffer of its own
            ctypes.CDLL(None).fflush(None)
        for fd, copy in kept:
            os.dup2(copy, fd)
            os.close(copy)
        os.close(nowhere)


def collect(
    function: Callable[..., Iterator[Result]], *args: Any, limit: float, each: bool = False
) -> list[Result]:
    """What `function(*args)` yields, run in the worker.

    limit: s for all of it, or with `each` for each item; a worker that takes longer is ended.
    Raises what the function raises, and WorkerDied with what had been delivered until then.
    """
    return list(function(*args)) if _inside else _own().collect(function, args, limit, each)


def survive(
    function: Callable[..., Iterator[Result]],
    items: Sequence[Item],
    *args: Any,
    lost: Callable[[Item, str], Result],
    limit: float,
    give_up: int = _GIVE_UP,
) -> list[Result]:
    """One result for each item, in order, whatever kills the worker.

    function: `function(items, *args)` yields one result for each item, in order.
    lost: makes the result of an item that the worker died on, from the item and the reason.
    limit: s for each item. give_up: deaths in a row, nothing done in between, after which no more is tried.
    """
    done: list[Result] = []
    deaths = 0
    while len(done) < len(items):
        rest = items[len(done) :]
        try:
            done += collect(function, rest, *args, limit=limit, each=True)
            assert len(done) == len(items), f"{len(done)} results for {len(items)} items"
        except WorkerDied as death:
            deaths = 1 if death.done else deaths + 1
            done += death.done
            done += [lost(item, death.got) for item in items[len(done) : len(done) + 1]]
            if deaths == give_up:
                reason = f"not tried: the engine died on the {give_up} before it ({death.got})"
                done += [lost(item, reason) for item in items[len(done) :]]
    return done


class Worker:
    """The worker process seen from its parent; starts when first asked."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Start anew; after a fork, in the child, the worker is the parent's."""
        process: subprocess.Popen[bytes] | None = getattr(self, "_process", None)
        if process is not None:
            process.returncode = 0  # nothing to wait for here
        self._process: subprocess.Popen[bytes] | None = None
        self.lock = threading.Lock()
        self._late = threading.Event()

    def collect(
        self, function: Callable[..., Iterator[Result]], args: Any, limit: float, each: bool
    ) -> list[Result]:
        """What `function(*args)` yields in the worker, within `limit` s, or each item within that."""
        with self.lock:
            done: list[Result] = []
            try:
                process = self._alive()
                with self._at_most(limit, process) as begin_anew:
                    send(process.stdin, (_working_directory(), function, args))
                    kind, value = receive(process.stdout)
                    while kind is Answer.ITEM:
                        done.append(value)
                        if each:
                            begin_anew()
                        kind, value = receive(process.stdout)
            except (EOFError, OSError) as error:
                how = self._cause_of_death(limit)
                raise WorkerDied("engine", how, "", "", done) from error
            except BaseException:  # an interrupt, or an answer that cannot be read
                self.close()
                raise
        if kind is Answer.RAISED:
            raise value
        return done

    def _alive(self) -> subprocess.Popen[bytes]:
        if self._process is not None and self._process.poll() is not None:
            self.close()
        if self._process is None:
            path = [str(entry) for entry in sys.path]
            code = f"import sys; sys.path[:] = {path!r}; from {serve.__module__} import serve; serve()"
            self._process = subprocess.Popen(
                [sys.executable, "-c", code],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
            with self._at_most(_START_S, self._process):
                receive(self._process.stdout)
        return self._process

    def _cause_of_death(self, limit: float) -> str:
        process = self._process
        assert process is not None
        code = None
        with suppress(subprocess.TimeoutExpired):
            code = process.wait(timeout=5.0)
        self.close()
        if self._late.is_set():
            return f"no answer within {limit:g} s"
        if code is not None and code < 0:
            return f"crashed with {signal.Signals(-code).name}"
        return f"its process ended with exit code {code}"

    def kill(self) -> None:
        """End what the worker is doing, for whoever waits for it."""
        if (process := self._process) is not None:
            process.kill()

    def close(self) -> None:
        """End the worker and everything held for it."""
        process, self._process = self._process, None
        if process is None:
            return
        process.kill()
        process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    @contextmanager
    def _at_most(self, limit: float, process: subprocess.Popen[bytes]) -> Iterator[Callable[[], None]]:
        """Kill the process unless the block ends within `limit` s; reads from it then see the end of file.

        Hands out a function that lets the time begin anew.
        """
        self._late.clear()
        end_at = time.monotonic() + limit
        over = threading.Event()

        def begin_anew() -> None:
            nonlocal end_at
            end_at = time.monotonic() + limit

        def watch() -> None:
            while (left := end_at - time.monotonic()) > 0:
                if over.wait(left):
                    return
            self._late.set()
            process.kill()

        threading.Thread(target=watch, daemon=True).start()
        try:
            yield begin_anew
        finally:
            over.set()


_shared = Worker()
_workers = [_shared]
_thread = threading.local()


def _own() -> Worker:
    found: Worker = getattr(_thread, "worker", _shared)
    return found


def take_own_worker() -> Worker:
    """Give the calling thread a worker of its own from now on, beside the one that all others share.

    For the threads of a pool: so many engines then run at once.
    """
    if not hasattr(_thread, "worker"):
        _thread.worker = Worker()
        _workers.append(_thread.worker)
    return _own()


def end_workers(workers: Sequence[Worker] | None = None) -> None:
    """End these workers, or all of this process; what they did is WorkerDied to those who wait for it."""
    ending = list(_workers if workers is None else workers)
    for worker in ending:
        worker.kill()
    for worker in ending:
        with worker.lock:
            worker.close()


def _forget_workers() -> None:
    for worker in _workers:
        worker.forget()


atexit.register(end_workers)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_workers)


def _working_directory() -> str:
    try:
        return os.getcwd()  # noqa: PTH109 - crosses as text
    except FileNotFoundError:
        return os.path.sep  # deleted under us
