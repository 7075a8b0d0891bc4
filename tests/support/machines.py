"""Other machines, simulated: `python -m machines [PYTEST ARGUMENTS]` runs the tests on each.

A machine joins what makes one unlike another: the kernels that OpenBLAS picks by processor, the instructions
that NumPy uses, threads, the seed of hashes, clock, language, user, home and the folder of the checkout. The
table at the end has the result on each; one that fails makes the exit code 1.
"""

from __future__ import annotations

import os
import pwd
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from numpy._core import _multiarray_umath as numpy_kernels  # type: ignore[attr-defined]

ROOT = Path(__file__).parents[2]
_KEPT = ("PATH", "LD_LIBRARY_PATH", "CC", "HCBENCH_ENGINES", "HCBENCH_ALL")
_LEFT_BEHIND = shutil.ignore_patterns(
    ".venv*", "*_cache", "__pycache__", "_build", "site", ".git", "last.json", ".hypothesis"
)


def other_kernels(processor: str = "Prescott") -> dict[str, str]:
    """Environment of a process that computes as on an old processor: NumPy without what can be disabled."""
    used = numpy_kernels.__cpu_features__
    features = [name for name in numpy_kernels.__cpu_dispatch__ if used.get(name)]
    return {"OPENBLAS_CORETYPE": processor, "NPY_DISABLE_CPU_FEATURES": " ".join(features)}


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine. environment: what it sets. home: whether its user has one. stranger: whether the user is
    another than this one, where this one may become another. folder: the name of its checkout's folder."""

    name: str
    environment: dict[str, str]
    home: bool = True
    stranger: bool = False
    folder: str = "hcbench"


MACHINES = (
    Machine(
        "Prescott, no SIMD in NumPy, 4 threads, C, Kathmandu, no home",
        {
            **other_kernels("Prescott"),
            **{"OMP_NUM_THREADS": "4", "PYTHONHASHSEED": "7", "TZ": "Asia/Kathmandu", "LC_ALL": "C"},
        },
        home=False,
    ),
    Machine(
        "Haswell, 1 thread, UTC, another user",
        {"OPENBLAS_CORETYPE": "Haswell", "OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "0", "TZ": "UTC"},
        stranger=True,
    ),
    Machine(
        "SkylakeX, 4 threads, LANG=C, a path with spaces",
        {"OPENBLAS_CORETYPE": "SkylakeX", "OMP_NUM_THREADS": "4", "PYTHONHASHSEED": "7", "LANG": "C"},
        folder="a check out",
    ),
    Machine(
        "Zen, no SIMD in NumPy, 1 thread, Chatham, another user, a path with spaces",
        {
            **other_kernels("Zen"),
            **{"OMP_NUM_THREADS": "1", "PYTHONHASHSEED": "7", "TZ": "Pacific/Chatham", "LANG": "C.UTF-8"},
        },
        stranger=True,
        folder="a check out",
    ),
    Machine(
        "Nehalem, no SIMD in NumPy, 4 threads, Caracas, no home, another user",
        {
            **other_kernels("Nehalem"),
            **{"OMP_NUM_THREADS": "4", "PYTHONHASHSEED": "0", "TZ": "America/Caracas", "LC_ALL": "C"},
        },
        home=False,
        stranger=True,
    ),
)


def run(machine: Machine, arguments: list[str]) -> tuple[int, str]:
    """The exit code of pytest on a machine, and the last line of what it says."""
    with _checkout(machine) as folder:
        temporary = folder.parent / "tmp"
        temporary.mkdir()
        environment = {name: os.environ[name] for name in _KEPT if name in os.environ}
        environment |= {"LANG": "C.UTF-8", "TMPDIR": str(temporary), "PYTHONPATH": str(folder)}
        environment |= machine.environment
        if machine.home:
            (folder.parent / "home").mkdir()
            environment["HOME"] = str(folder.parent / "home")
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        if machine.stranger and os.getuid() == 0:
            command = [*_as_nobody(folder.parent), *command]
        with subprocess.Popen(
            command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True, encoding="utf-8"
        ) as process:
            last = ""
            assert process.stdout is not None
            for line in process.stdout:
                print(line, end="", flush=True)
                last = line.strip() or last
        return process.returncode, last


@contextmanager
def _checkout(machine: Machine) -> Iterator[Path]:
    """A copy of the repository in a folder of the machine's name."""
    with tempfile.TemporaryDirectory(prefix="hcbench-", ignore_cleanup_errors=True) as above:
        folder = Path(above) / machine.folder
        shutil.copytree(ROOT, folder, symlinks=True, ignore=_LEFT_BEHIND)
        (folder / ".venv").symlink_to(Path(sys.prefix))
        yield folder


def _as_nobody(folder: Path) -> list[str]:
    """Give a folder to the user nobody; the words before a command that make it his.

    He may read what only root can: a Python in root's home. He may write in his folder alone.
    """
    user = pwd.getpwnam("nobody")
    for each in (folder, *folder.rglob("*")):
        os.chown(each, user.pw_uid, user.pw_gid, follow_symlinks=False)
    read = ("--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search")
    return ["setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups", *read]


def main(arguments: list[str]) -> int:
    """Run the tests on every machine, and print the table. 1 where one of them failed."""
    results = []
    for machine in MACHINES:
        print(f"\n=== {machine.name}", flush=True)
        results.append(run(machine, arguments))
    widest = max(len(machine.name) for machine in MACHINES)
    print()
    for machine, (code, last) in zip(MACHINES, results, strict=True):
        print(f"{machine.name:<{widest}}  {'green' if code == 0 else 'RED'}  {last.strip('= ')}")
    return max(int(code != 0) for code, _ in results)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
