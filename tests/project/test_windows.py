"""hcbench without what only POSIX has: a process that imports and runs it as on Windows."""

from __future__ import annotations

import subprocess
import sys

WITHOUT_POSIX = """
import importlib, os, pkgutil, signal, sys
import asyncio, concurrent.futures, multiprocessing.pool, subprocess, tempfile  # these know their system
import matplotlib.pyplot, mujoco.rollout, numpy, pandas, pyarrow, scipy.optimize, scipy.stats, rich.console
try:
    import distributed, pytest
except ImportError:
    pass
posix = ("fcntl", "grp", "pty", "pwd", "resource", "syslog", "termios", "tty")
for name in posix:
    sys.modules[name] = None
windows = {"SIGABRT", "SIGFPE", "SIGILL", "SIGINT", "SIGSEGV", "SIGTERM"}
for name in {str(each.name) for each in signal.Signals} - windows:
    delattr(signal, name)
for name in ("O_CLOEXEC", "O_DIRECTORY", "O_NOFOLLOW", "chown", "fork", "forkpty", "getegid", "geteuid",
             "getgid", "getpgid", "getuid", "killpg", "mkfifo", "sched_getaffinity", "setsid", "uname"):
    if hasattr(os, name):
        delattr(os, name)
import hcbench
for module in pkgutil.walk_packages(hcbench.__path__, "hcbench."):
    if module.name.endswith("__main__"):
        continue
    try:
        importlib.import_module(module.name)
    except ModuleNotFoundError as error:  # an engine that is not installed
        assert error.name not in posix, module.name
from hcbench import cli
assert cli.run(["law", "--alpha=0.3 s/m", "--speeds=0.5 m/s"]) == 0
assert cli.run(["convert", "--alpha=0.3 s/m", "--speed=0.5 m/s"]) == 0
"""


def test_every_module_imports_and_a_command_runs_without_what_windows_lacks() -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_POSIX], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
