"""One worker process as its parent sees it, and the main loop that it runs."""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing import Pipe
from pathlib import Path
from typing import Any, NoReturn, TypeVar
from weakref import WeakSet

from hcbench.environments import ADD
from hcbench.errors import CannotRun, EngineFailed, EngineMissing
from hcbench.workers.clock import processor_seconds
from hcbench.workers.message import CallEnd, pickled, portable

Result = TypeVar("Result")

_IDLE = 0.05  # share of the time that a process at work gets, on the busiest machine
_START_S = 60.0  # for a new interpreter to come up on a busy machine


class WorkerDied(EngineFailed):
    """The worker process crashed or hung. results: what it had sent until then."""

    results: Sequence[Any] = ()


@dataclass(frozen=True, slots=True)
class Interpreter:
    """A Python of another environment, for worker processes.

    name: of the environment. python: the executable. setup: code that makes hcbench importable there.
    """

    name: str
    python: str
    setup: str


_is_worker = False
_environment = ""  # the name of this process' Interpreter


def mark_as_worker(environment: str = "") -> None:
    """Declare this process to be hcbench's own: engines then run in it, in place.

    environment: the name of the Interpreter that it was started in.
    To be called first thing in a process. It ignores Ctrl-C from then on: a terminal sends that to every
    process, and the parent decides what becomes of its workers.
    """
    global _is_worker, _environment
    _is_worker, _environment = True, environment
    with suppress(ValueError):  # not the main thread: then interrupts do not come here anyway
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def in_worker() -> bool:
    """Whether this process is hcbench's own."""
    return _is_worker


def environment() -> str:
    """The name of the environment that this worker process was started in; "" for the user's own."""
    return _environment


class Worker:
    """A worker process as seen from its parent. Started when first used, and again after a crash.

    interpreter: what runs it; None for this process' own.
    """

    def __init__(self, interpreter: Interpreter | None = None) -> None:
        self._interpreter, self._others = interpreter, dict[Interpreter, Worker]()
        self._process: subprocess.Popen[bytes] | None = None
        self.reset_after_fork()
        _workers.add(self)

    def reset_after_fork(self) -> None:
        """Begin again: in the child of a fork, the process is its parent's."""
        if self._process is not None:
            self._process.returncode = 0  # nothing to wait for here
        self._process, self._is_up = None, False
        self._lock, self._closed = threading.Lock(), False

    def at(self, interpreter: Interpreter | None) -> Worker:
        """The worker beside this one that another interpreter runs; it ends with this one."""
        if interpreter is None:
            return self
        other = self._others.setdefault(interpreter, Worker(interpreter))
        other._closed |= self._closed
        return other

    def run(
        self, function: Callable[..., Iterator[Result]], args: tuple[Any, ...], limit: float | None
    ) -> list[Result]:
        """What `function(*args)` yields in the worker, each result within `limit` s."""
        results: list[Result] = []
        with self._lock:
            try:
                if self._process is None or self._process.poll() is not None:
                    self._start()
                if not self._is_up:
                    self._receive([], _START_S)
                    self._is_up = True
                self._pipe.send_bytes(pickled((_working_directory(), function, args)))
                error = self._receive(results, limit)
            except (EOFError, OSError) as error:
                death = WorkerDied("engine", self._cause_of_death(error), "")
                death.results = results
                self._kill()
                raise death from error
            except BaseException:  # an interrupt, or an answer that cannot be read
                self._kill()
                raise
        if error is not None:
            raise error
        return results

    def begin(self, module: str, function: str, *args: Any) -> None:
        """Start the process, unless there is one, and let it call a function of a module first.

        Nothing is waited for, and what the function raises is dropped.
        """
        with self._lock:
            if self._process is None and not self._closed:
                self._start((module, function, args))

    def _start(self, first: tuple[str, str, tuple[Any, ...]] | None = None) -> None:
        self._kill()
        self._pipe, end = Pipe()
        path = [str(entry) for entry in sys.path]
        setup, command, name = f"import sys; sys.path[:] = {path!r}", [sys.executable], ""
        if self._interpreter is not None:
            # -I: nothing of this process' environment is found there, regardless of PYTHONPATH.
            setup, command = self._interpreter.setup, [self._interpreter.python, "-I"]
            name = self._interpreter.name
            if not Path(command[0]).exists():
                raise EngineMissing(f"engine {name!r}", "its environment is gone", "", f"Try: {ADD} {name}")
        code = f"{setup}\nfrom {__name__} import serve\nserve({end.fileno()}, {name!r}, {first!r})"
        with end:
            self._process = subprocess.Popen(
                [*command, "-c", code],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                **_inherit(end.fileno()),
            )
        if self._closed:  # by another thread
            raise CannotRun("worker", "is no longer needed", "")

    def _receive(self, results: list[Any], limit: float | None) -> Exception | None:
        """Append what the worker sends to `results`, and return the error that ended it."""
        while self._answers(limit):
            answer = self._pipe.recv()
            if isinstance(answer, CallEnd):
                return answer.error
            results.append(answer)
        raise TimeoutError(f"no answer within {limit:g} s")

    def _answers(self, limit: float | None) -> bool:
        """Whether something comes within `limit` s, as long as the process takes them of a processor.

        On a busy machine that is longer by the clock; a process that hardly runs at all counts as hung.
        """
        if limit is None or self._process is None:
            return self._pipe.poll(limit)
        begun = used = processor_seconds(self._process.pid)
        while not self._pipe.poll(limit):
            before, used = used, processor_seconds(self._process.pid)
            if used - before < _IDLE * limit or used - begun >= limit:
                return False
        return True

    def _cause_of_death(self, error: Exception) -> str:
        if isinstance(error, TimeoutError):
            return str(error)
        code = None
        if self._process is not None:
            with suppress(subprocess.TimeoutExpired):
                code = self._process.wait(timeout=5.0)
        if code is not None and code < 0:
            return f"crashed with {signal.Signals(-code).name}"
        return f"its process ended with exit code {code}"

    def close(self) -> None:
        """End the process for good, at any point: who waits for it gets WorkerDied or CannotRun."""
        self._closed = True
        for other in list(self._others.values()):
            other.close()
        if (process := self._process) is not None:
            process.kill()
        with self._lock:
            self._kill()

    def __del__(self) -> None:  # its thread has ended
        self._kill()

    def _kill(self) -> None:
        process, self._process, self._is_up = self._process, None, False
        if process is not None:
            process.kill()
            process.wait()
            self._pipe.close()


def _inherit(handle: int) -> dict[str, Any]:
    """The arguments of Popen by which the process, and no other that is just being started, gets a handle."""
    if sys.platform == "win32":
        os.set_handle_inheritable(handle, True)
        return {"startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})}
    return {"pass_fds": [handle]}


def _working_directory() -> str:
    try:
        return os.getcwd()  # noqa: PTH109 - crosses as text
    except FileNotFoundError:
        return os.path.sep  # deleted under us


def serve(
    handle: int, environment: str = "", first: tuple[str, str, tuple[Any, ...]] | None = None
) -> NoReturn:
    """The main loop of a worker process: answers requests on a pipe until it closes.

    first: a module, a function of it and arguments, called before any request; what it raises is dropped.
    """
    mark_as_worker(environment)
    pipe = type(Pipe()[0])(handle)
    error: Exception | None = None
    with suppress(EOFError, OSError):  # the parent has gone
        while True:
            pipe.send_bytes(pickled(CallEnd(error)))
            if first is not None:
                (module, function, args), first = first, None
                with suppress(Exception):
                    getattr(import_module(module), function)(*args)
            request = pipe.recv_bytes()
            try:
                folder, function, args = pickle.loads(request)
                os.chdir(folder)  # the parent's: relative paths mean the same here
                for result in function(*args):
                    pipe.send_bytes(pickled(result))
                error = None
            except Exception as raised:
                error = portable(raised)
    os._exit(0)


_workers: WeakSet[Worker] = WeakSet()  # of this process
_shared = Worker()
_thread = threading.local()


def worker_of_thread() -> Worker:
    """The worker process of the calling thread; most threads share one."""
    worker: Worker = getattr(_thread, "worker", _shared)
    return worker


def use_own_worker(worker: Worker | None = None) -> None:
    """Give the calling thread a worker process of its own, unless it has one; other threads share one.

    For the threads of executors other than a WorkerPool's: so many engines then run at once.
    """
    if not hasattr(_thread, "worker"):
        _thread.worker = worker or Worker()


def _for_all_workers(action: Callable[[Worker], None]) -> None:
    for worker in list(_workers):
        action(worker)


atexit.register(_for_all_workers, Worker.close)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=partial(_for_all_workers, Worker.reset_after_fork))
