"""Other machines, simulated: `python -m machines [PYTEST ARGUMENTS]` runs the tests on each.

A machine joins what makes one unlike another: the kernels that OpenBLAS picks by processor, the
instructions that NumPy uses, threads, the seed of hashes, clock, language, user, home and the
folder of the checkout. Each runs in a clone of the commit that is checked out, with an environment
that `make` made there. The table at the end has the result on each, and what of a machine could not
be had here; the exit code is 1 where one failed.
"""

from __future__ import annotations

import os
import pwd
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy._core import _multiarray_umath as numpy_kernels  # type: ignore[attr-defined]

ROOT = Path(__file__).parents[2]
_KEPT = ("PATH", "LD_LIBRARY_PATH", "CC", "HCBENCH_ENGINES")
_STRANGER = "nobody"


def other_kernels(processor: str = "Prescott") -> dict[str, str]:
    """Environment of a process that computes as on an old processor:
    NumPy without what can be disabled.
    """
    used = numpy_kernels.__cpu_features__
    features = [name for name in numpy_kernels.__cpu_dispatch__ if used.get(name)]
    return {"OPENBLAS_CORETYPE": processor, "NPY_DISABLE_CPU_FEATURES": " ".join(features)}


@dataclass(frozen=True, slots=True)
class Machine:
    """One machine. environment: what it sets. instructions: what of the processor, in NumPy's
    words, its kernels cannot run without. home: whether its user has one. stranger: whether the
    user is another than this one. folder: the name of its checkout's folder.
    """

    name: str
    environment: dict[str, str]
    instructions: str = ""
    home: bool = True
    stranger: bool = False
    folder: str = "hcbench"


MACHINES = (
    Machine(
        "Prescott, no SIMD in NumPy, 4 threads, C, Kathmandu, no home",
        {
            **other_kernels("Prescott"),
            **{
                "OMP_NUM_THREADS": "4",
                "PYTHONHASHSEED": "7",
                "TZ": "Asia/Kathmandu",
                "LC_ALL": "C",
            },
        },
        home=False,
    ),
    Machine(
        "Haswell, 1 thread, UTC, another user",
        {
            "OPENBLAS_CORETYPE": "Haswell",
            "OMP_NUM_THREADS": "1",
            "PYTHONHASHSEED": "0",
            "TZ": "UTC",
        },
        instructions="AVX2",
        stranger=True,
    ),
    Machine(
        "SkylakeX, 4 threads, LANG=C, a path with spaces",
        {
            "OPENBLAS_CORETYPE": "SkylakeX",
            "OMP_NUM_THREADS": "4",
            "PYTHONHASHSEED": "7",
            "LANG": "C",
        },
        instructions="AVX512_SKX",
        folder="a check out",
    ),
    Machine(
        "Zen, no SIMD in NumPy, 1 thread, Chatham, another user, a path with spaces",
        {
            **other_kernels("Zen"),
            **{
                "OMP_NUM_THREADS": "1",
                "PYTHONHASHSEED": "7",
                "TZ": "Pacific/Chatham",
                "LANG": "C.UTF-8",
            },
        },
        instructions="AVX2",
        stranger=True,
        folder="a check out",
    ),
    Machine(
        "Nehalem, no SIMD in NumPy, 4 threads, Caracas, no home, another user",
        {
            **other_kernels("Nehalem"),
            **{
                "OMP_NUM_THREADS": "4",
                "PYTHONHASHSEED": "0",
                "TZ": "America/Caracas",
                "LC_ALL": "C",
            },
        },
        home=False,
        stranger=True,
    ),
)


@dataclass(frozen=True, slots=True)
class Result:
    """The last line of pytest on a machine, and what of the machine could not be had here."""

    machine: Machine
    verdict: str
    last: str = ""
    missing: str = ""


def run(machine: Machine, arguments: list[str]) -> Result:
    """Run pytest on a machine."""
    if machine.instructions and not numpy_kernels.__cpu_features__.get(machine.instructions):
        return Result(machine, "not run", missing=f"this processor has no {machine.instructions}")
    python: str = sys._base_executable  # type: ignore[attr-defined]
    user: dict[str, Any] = {}
    missing = ""
    if machine.stranger:
        python, user, missing = _as_a_stranger(python)
    with tempfile.TemporaryDirectory(prefix="hcbench-", ignore_cleanup_errors=True) as above:
        folder = Path(above) / machine.folder
        _check_out(folder, python)
        environment = _environment(machine, folder)
        if user:
            _give(Path(above), user)
        command = [str(folder / ".venv/bin/python"), "-m", "pytest", "-q", "-p", "no:cacheprovider"]
        with subprocess.Popen(
            [*command, *arguments],
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            encoding="utf-8",
            **user,
        ) as process:
            last = ""
            assert process.stdout is not None
            for line in process.stdout:
                print(line, end="", flush=True)
                last = line.strip() or last
    return Result(machine, "RED" if process.returncode else "green", last.strip("= "), missing)


def _as_a_stranger(python: str) -> tuple[str, dict[str, Any], str]:
    """A Python that another user can run, what makes a process his, and
    why there is none of that, if so.

    The Python in use may lie in the home of root, where nobody else can read.
    """
    if os.name != "posix" or os.getuid() != 0:
        return python, {}, "the user is this one: only root can become another"
    found = pwd.getpwnam(_STRANGER)
    user: dict[str, Any] = {"user": found.pw_uid, "group": found.pw_gid, "extra_groups": []}
    name = f"python{sys.version_info.major}.{sys.version_info.minor}"
    folders = os.environ.get("PATH", os.defpath).split(os.pathsep)
    for candidate in (python, *(str(Path(folder) / name) for folder in folders)):
        try:
            probe = [candidate, "-c", "import venv, ensurepip"]
            subprocess.run(probe, cwd="/", check=True, capture_output=True, **user)
        except (OSError, subprocess.CalledProcessError):
            continue
        return candidate, user, ""
    return python, {}, f"the user is this one: {_STRANGER} can run no {name} of this machine"


def _check_out(folder: Path, python: str) -> None:
    """A clone of the repository, and its environment as a newcomer makes it.

    Copies, no hard links: a file that is given to another user must not be the
    one of this checkout or of uv.
    """
    subprocess.run(
        ["git", "clone", "--quiet", "--no-hardlinks", str(ROOT), str(folder)], check=True
    )
    copies = {**os.environ, "UV_LINK_MODE": "copy"}
    make = ["make", "--no-print-directory", ".venv/.installed", f"PYTHON={python}"]
    subprocess.run(make, cwd=folder, env=copies, check=True)


def _environment(machine: Machine, folder: Path) -> dict[str, str]:
    """The environment of the machine's processes; its home and its
    folder of temporary files are made.
    """
    environment = {name: os.environ[name] for name in _KEPT if name in os.environ}
    folders = {"TMPDIR": folder.parent / "tmp"}
    if machine.home:
        folders["HOME"] = folder.parent / "home"
    for name, place in folders.items():
        place.mkdir()
        environment[name] = str(place)
    return {**environment, "LANG": "C.UTF-8", **machine.environment}


def _give(folder: Path, user: dict[str, Any]) -> None:
    """Make a user the owner of a folder and all in it. He may write there alone."""
    for each in (folder, *folder.rglob("*")):
        os.chown(each, user["user"], user["group"], follow_symlinks=False)


def main(arguments: list[str]) -> int:
    """Run the tests on every machine, and print the table. 1 where one of them failed.

    HCBENCH_MACHINES: words of which a machine's name must have one; all machines without it.
    """
    words = os.environ.get("HCBENCH_MACHINES", "").split()
    machines = [each for each in MACHINES if not words or any(word in each.name for word in words)]
    if not machines:
        names = "\n".join(each.name for each in MACHINES)
        print(
            f"HCBENCH_MACHINES: {' '.join(words)}: no machine has one of these words. There are:\n{names}"
        )
        return 2
    if subprocess.run(["git", "diff", "--quiet", "HEAD"], cwd=ROOT, check=False).returncode:
        print(
            "Changes that are not committed are left out: each machine has a clone of the last commit."
        )
    results = []
    for machine in machines:
        print(f"\n=== {machine.name}", flush=True)
        results.append(run(machine, arguments))
    widest = max(len(machine.name) for machine in machines)
    print()
    for result in results:
        rest = "; ".join(filter(None, (result.last, result.missing)))
        print(f"{result.machine.name:<{widest}}  {result.verdict:<7}  {rest}")
    return max(int(result.verdict == "RED") for result in results)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
