"""Forked copies of this process, which end with it."""

from __future__ import annotations

import ctypes
import gc
import math
import os
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from contextlib import suppress
from typing import NoReturn

# Elsewhere than on Linux, libraries that draw may not survive a fork.
AVAILABLE = sys.platform == "linux"
# PR_SET_PDEATHSIG of prctl(2).
_SET_PARENT_DEATH_SIGNAL = 1
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
        """The exit code, once there is one. Raises subprocess.TimeoutExpired after `timeout` s."""
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
        ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
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
