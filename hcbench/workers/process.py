"""Processes as their parent sees them: worker processes, and forked copies of this one."""

from __future__ import annotations

import atexit
import ctypes
import gc
import math
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn, TypeVar
from weakref import WeakSet

from hcbench.environments import ADD
from hcbench.system.errors import CannotRun, EngineFailed, EngineMissing
from hcbench.system.process import IS_COMMAND
from hcbench.workers.serve import CallEnd, FirstCall, pickled, serve, serve_forked

# Processor time of a process.


def processor_seconds(number: int) -> float:
    """Processor time of a process and its ended children, s; 0 if the system does not report it.

    number: of the process.
    """
    try:
        content = Path(f"/proc/{number}/stat").read_text(encoding="ascii", errors="replace")
        # proc(5): field 2 is the name, in brackets, and may hold spaces. utime, stime, cutime and
        # cstime are fields 14 to 17, in ticks.
        _, _, from_field_3 = content.rpartition(")")
        ticks = sum(map(int, from_field_3.split()[11:15]))
        return ticks / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, AttributeError):
        return 0.0


Result = TypeVar("Result")

# Share of the time that a process at work gets, on the busiest machine.
_IDLE = 0.05
# Longest wait of this process, s: the system counts it in milliseconds of 32 bits.
_LONGEST_S = 1e6
# Time for a new interpreter to come up on a busy machine, s.
_START_S = 60.0


class WorkerDied(EngineFailed):
    """The worker process crashed or hung.

    results: what it had sent until then.
    """

    results: Sequence[Any] = ()


@dataclass(frozen=True, slots=True)
class Interpreter:
    """A Python of another environment, for worker processes.

    name: of the environment.
    python: the executable.
    setup: code that makes hcbench importable there.
    """

    name: str
    python: str
    setup: str


class Worker:
    """A worker process as seen from its parent. Started when first used, and again after a crash.

    interpreter: what runs it; None for this process' own.
    """

    def __init__(self, interpreter: Interpreter | None = None) -> None:
        self._interpreter = interpreter
        # Workers beside this one that other interpreters run; they end with it.
        self._others = dict[Interpreter, Worker]()
        self._process: subprocess.Popen[bytes] | Fork | None = None
        self.reset_after_fork()
        _workers.add(self)

    def reset_after_fork(self) -> None:
        """Forget the process, without ending it: in the child of a fork, it is the parent's."""
        if self._process is not None:
            # There is nothing to wait for here.
            self._process.returncode = 0
            self._pipe.close()
        self._process = None
        self._is_up = False
        self._lock = threading.Lock()
        self._closed = False

    def at(self, interpreter: Interpreter | None) -> Worker:
        """The worker beside this one that another interpreter runs; it ends with this one."""
        if interpreter is None:
            return self
        other = self._others.setdefault(interpreter, Worker(interpreter))
        other._closed |= self._closed
        return other

    def run(
        self,
        function: Callable[..., Iterator[Result]],
        args: tuple[Any, ...],
        limit: float | None,
        longest: float = math.inf,
    ) -> list[Result]:
        """Run the generator `function(*args)` in the worker and return all it yields, each within
        both limits.

        limit: s of its processor time; a process that is idle for as long counts as hung, too.
        None: it is waited for for ever, and `longest` does not count.
        longest: s of the clock, with a limit; infinity for none.

        Raises what the function raises, and WorkerDied, with the results until then, where the
        process did not start, crashed or took longer; EngineMissing where the environment of the
        interpreter is gone; CannotRun where this worker was closed. The process that raised goes on,
        and serves the next call; after any other end the next call starts another.
        """
        results: list[Result] = []
        with self._lock:
            try:
                if self._process is None or self._process.poll() is not None:
                    self._start()
                if not self._is_up:
                    self._receive([], _START_S)
                    self._is_up = True
                self._pipe.send_bytes(pickled((_working_directory(), function, args)))
                error = self._receive(results, limit, longest)
            except (EOFError, OSError) as error:
                death = WorkerDied("engine", self._cause_of_death(error), "")
                death.results = results
                self._kill()
                raise death from error
            # An interrupt, or an answer that cannot be read, leaves the
            # pipe in the middle of a message.
            except BaseException:
                self._kill()
                raise
        if error is not None:
            raise error
        return results

    def begin(self, module: str, function: str, *args: Any) -> None:
        """Start the process, unless there is one, and let it call a function of a module first.

        In a command it is a copy of this one, which imports nothing again, where the system can.
        Nothing is waited for, and what the function raises is dropped.
        Raises EngineMissing where the environment of the interpreter is gone.
        """
        with self._lock:
            if self._process is None and not self._closed:
                self._start((module, function, args))

    def _start(self, first: FirstCall | None = None) -> None:
        """Start a process in place of the one before, as a copy of this one where that is safe.

        Called with `_lock` held.
        first: called in it before anything else.
        Raises CannotRun where the worker was closed meanwhile: `close` waits for the lock, and then
        ends the process.
        Raises EngineMissing as `_spawn`.
        """
        self._kill()
        self._pipe, end = Pipe()
        with end:
            if first is not None and can_fork():
                self._process = Fork(partial(serve_forked, end, first))
            else:
                self._process = self._spawn(end, first)
        # Another thread has closed it meanwhile. This comes last: `close` looks at `_process`, and
        # one that is set after it looked would live on.
        if self._closed:
            raise CannotRun("worker", "is no longer needed", "")

    def _spawn(self, end: Connection, first: FirstCall | None) -> subprocess.Popen[bytes]:
        """A fresh interpreter that serves one end of a pipe.

        first: called in it before any request.
        Raises EngineMissing where its environment is gone.
        """
        path = [str(entry) for entry in sys.path]
        setup = f"import sys; sys.path[:] = {path!r}"
        command = [sys.executable]
        name = ""
        if self._interpreter is not None:
            # -I: nothing of this process' environment is found there, regardless of PYTHONPATH.
            setup = self._interpreter.setup
            command = [self._interpreter.python, "-I"]
            name = self._interpreter.name
            if not Path(self._interpreter.python).exists():
                raise EngineMissing(
                    f"engine {name!r}", "its environment is gone", "", f"Try: {ADD} {name}"
                )
        code = f"{setup}\nfrom {serve.__module__} import serve\nserve({end.fileno()}, {name!r}, {first!r})"
        return subprocess.Popen(
            [*command, "-c", code],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            **_inherit(end.fileno()),
        )

    def _receive(
        self, results: list[Any], limit: float | None, longest: float = math.inf
    ) -> Exception | None:
        """Append what the worker sends to `results`, until it says that the call has ended; return
        the error that the function raised, None for none.

        limit, longest: for each answer, as for `run`.
        Raises TimeoutError where an answer takes longer; EOFError or OSError where the process has
        ended.
        """
        while self._answers(limit, longest):
            answer = self._pipe.recv()
            if isinstance(answer, CallEnd):
                return answer.error
            results.append(answer)
        raise TimeoutError(f"no answer within {min(limit or math.inf, longest):g} s")

    def _answers(self, limit: float | None, longest: float) -> bool:
        """Wait for an answer; False if there is none after `longest` s of the clock, or after
        `limit` s of the process' processor time. With None for `limit` it waits for ever.

        On a busy machine the wait for its time is longer by the clock. A process that hardly runs
        at all counts as hung.
        """
        if limit is None or self._process is None:
            return self._pipe.poll(limit)
        # Processor time of the process, s, at the begin and at the last look.
        begun = processor_seconds(self._process.pid)
        used = begun
        # The pipe takes no longer wait; `longest` may be infinite.
        limit = min(limit, _LONGEST_S)
        end = time.monotonic() + longest
        wait = min(limit, longest)
        # A process cannot use more time than has gone by: it is looked at when it could be too late.
        while not self._pipe.poll(wait):
            before = used
            used = processor_seconds(self._process.pid)
            left = end - time.monotonic()
            is_idle = used - before < _IDLE * wait
            if is_idle or used - begun >= limit or left <= 0.0:
                return False
            wait = min(limit, left)
        return True

    def _cause_of_death(self, error: Exception) -> str:
        """The reason why the process does not answer, in words: not started, too late, a signal, or
        its exit code; it has up to 5 s to end.

        error: what `_start`, `_receive`, or sending, raised.
        """
        if isinstance(error, TimeoutError):
            return str(error)
        if self._process is None:
            return f"its process did not start: {error}"
        code = None
        with suppress(subprocess.TimeoutExpired):
            code = self._process.wait(timeout=5.0)
        if code is None:
            return "its process no longer answers, and did not end"
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

    # The thread of this worker has ended.
    def __del__(self) -> None:
        self._kill()

    def _kill(self) -> None:
        """End the process at once, and wait for its end; the next call starts another."""
        process = self._process
        self._process = None
        self._is_up = False
        if process is not None:
            process.kill()
            process.wait()
            self._pipe.close()


def _inherit(handle: int) -> dict[str, Any]:
    """Arguments of Popen by which the process alone, and no other that is just being started, gets
    a handle: a file descriptor, or a handle of Windows.
    """
    if sys.platform == "win32":
        os.set_handle_inheritable(handle, True)
        return {"startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})}
    return {"pass_fds": [handle]}


def _working_directory() -> str:
    try:
        return os.getcwd()  # noqa: PTH109 - crosses as text
    except FileNotFoundError:
        # The folder was deleted while this process was in it.
        return os.path.sep


# The workers of this process.
_workers: WeakSet[Worker] = WeakSet()
_shared = Worker()
_thread = threading.local()


def worker_of_thread() -> Worker:
    """The worker process of the calling thread; most threads share one."""
    worker: Worker = getattr(_thread, "worker", _shared)
    return worker


def use_own_worker(worker: Worker | None = None) -> None:
    """Give the calling thread a worker process of its own, unless it has one. Threads that never
    call this share one worker, and so run one engine at a time.

    worker: None for a new one, which is started at its first use.

    A WorkerPool does it for its threads; other executors' threads have to call it.
    """
    if not hasattr(_thread, "worker"):
        _thread.worker = worker or Worker()


def _for_all_workers(action: Callable[[Worker], None]) -> None:
    for worker in list(_workers):
        action(worker)


atexit.register(_for_all_workers, Worker.close)
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=partial(_for_all_workers, Worker.reset_after_fork))


# Elsewhere than on Linux, libraries that draw may not survive a fork.
CAN_FORK = sys.platform == "linux"


def can_fork() -> bool:
    """Say whether a worker that begins now is a copy of this process, which shares its memory."""
    # A fork copies the locks that other threads hold, and nobody there lets them go.
    return CAN_FORK and IS_COMMAND.get() and threading.active_count() == 1


# PR_SET_PDEATHSIG of prctl(2).
_SET_PARENT_DEATH_SIGNAL = 1
# Found once, here: what a copy would look up, it would copy the pages of.
_prctl = ctypes.CDLL(None).prctl if CAN_FORK else None
# Time between two looks at whether the copy has ended, s.
_POLL_S = 1e-3


class Fork:
    """A copy of this process that runs a function and ends; waited for as subprocess.Popen's are.

    Only on Linux. The copy is killed where this process ends first.

    returncode: as of Popen; None while the copy is not known to have ended.
    """

    def __init__(self, function: Callable[[], object]) -> None:
        """Fork, and let the copy run `function`; in the copy this never returns.

        Raises OSError where the system has no room for another process.
        """
        self.returncode: int | None = None
        parent = os.getpid()
        # Python warns of forks where there are other threads: here those of BLAS.
        with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
            self.pid = os.fork()
        if not self.pid:
            _run(parent, function)

    def poll(self) -> int | None:
        """The exit code, negative for a signal; None while the copy runs."""
        return self._wait(os.WNOHANG)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end, and return the exit code, negative for a signal. Raises
        subprocess.TimeoutExpired after `timeout` s; None: waits for ever.
        """
        options = 0
        end = math.inf
        if timeout is not None:
            options = os.WNOHANG
            end = time.monotonic() + timeout
        while (code := self._wait(options)) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired("fork", timeout or 0.0)
            time.sleep(_POLL_S)
        return code

    def kill(self) -> None:
        """End the copy at once."""
        if self.returncode is None:
            with suppress(ProcessLookupError):
                os.kill(self.pid, signal.SIGKILL)

    def _wait(self, options: int) -> int | None:
        """The exit code, negative for a signal; None while the copy runs, with WNOHANG.

        options: of waitpid: 0 waits for the end.
        """
        if self.returncode is None:
            try:
                ended, status = os.waitpid(self.pid, options)
            except ChildProcessError:
                # Where SIGCHLD is ignored, the system drops the exit status; Popen says 0, too.
                ended, status = self.pid, 0
            if ended:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode


def _run(parent: int, function: Callable[[], object]) -> NoReturn:
    """Run a function in the copy and end with exit code 0, also where it raises.

    parent: id of the process that forked. Only os._exit leaves: anything else would run on in the
    program of the parent.
    """
    try:
        assert _prctl is not None, "only Linux forks here"
        _prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
        # Objects of the parent's are not looked at again, so that both go on sharing its memory.
        gc.freeze()
        for number in signal.valid_signals():
            # The parent's own way to end at a signal is not the copy's.
            if callable(signal.getsignal(number)):
                signal.signal(number, signal.SIG_DFL)
        # A parent that ended before prctl was called has sent no signal.
        if os.getppid() == parent:
            function()
    finally:
        os._exit(0)
