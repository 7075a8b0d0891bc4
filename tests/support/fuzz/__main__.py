"""`make fuzz`: random inputs in one process, some as processes, signals at random
times, calls, and mutated files.

Prints what went wrong with its number, by which `--only` runs it again; exit 1 where anything did.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import random
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from pathlib import Path

from fuzz.calls import call
from fuzz.files import READERS, mutate
from fuzz.inputs import make
from fuzz.judge import faults

MOST_CPU_S = 60.0
_PROCESS = [sys.executable, "-m", "hcbench"]
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def in_this_process(numbers: range, folder: Path, deadline: float) -> list[str]:
    """Run inputs by `hcbench.cli.run`. A thread ends the process where one hangs."""
    from hcbench import cli

    warnings.simplefilter("ignore")
    wrong, codes, slowest, current = [], Counter[int](), (0.0, 0), [0, time.monotonic()]

    def watch() -> None:
        while current:
            time.sleep(5)
            if current and time.monotonic() - current[1] > 20 * MOST_CPU_S:
                print(f"{current[0]}: HUNG", flush=True)
                os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    done = 0
    for number in numbers:
        if time.monotonic() > deadline:
            break
        arguments = make(folder, number)
        current[:] = [number, time.monotonic()]
        out, err, began = io.StringIO(), io.StringIO(), time.process_time()
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code = cli.run(arguments)
        except BaseException as error:
            code, _ = -1, err.write(f"Traceback {type(error).__name__}: {error}")
        took = time.process_time() - began
        slowest = max(slowest, (took, number))
        found = faults(arguments, code, out.getvalue(), err.getvalue())
        found += [f"{took:.0f} s of CPU"] if took > MOST_CPU_S else []
        codes[code] += 1
        done += 1
        wrong += [_told(number, arguments, fault, err.getvalue()) for fault in found]
        if done % 1000 == 0:
            print(f"{done} inputs, {len(wrong)} faults, exit codes {dict(codes)}", flush=True)
    current.clear()  # which ends the thread
    print(
        f"{done} inputs in one process: {len(wrong)} faults; exit codes {dict(sorted(codes.items()))}; ",
        end="",
    )
    print(f"the slowest took {slowest[0]:.1f} s of CPU (number {slowest[1]})", flush=True)
    return wrong


def _told(number: int, arguments: list[str], fault: str, err: str) -> str:
    line = f"{number}: {fault}: hcbench {' '.join(map(repr, arguments))} {err[-300:]!r}"
    print(line, flush=True)
    return line


def as_processes(numbers: range, folder: Path) -> list[str]:
    """Run inputs as commands."""
    wrong = []
    for number in numbers:
        arguments = make(folder, number)
        try:
            done = subprocess.run(
                [*_PROCESS, *arguments],
                capture_output=True,
                text=True,
                errors="replace",
                timeout=20 * MOST_CPU_S,
                check=False,
            )
        except (subprocess.TimeoutExpired, ValueError) as error:  # a null in an argument is none's
            wrong += (
                [_told(number, arguments, "hung", "")]
                if isinstance(error, subprocess.TimeoutExpired)
                else []
            )
            continue
        wrong += [
            _told(number, arguments, f, done.stderr)
            for f in faults(arguments, done.returncode, done.stdout, done.stderr)
        ]
    print(f"{len(numbers)} inputs as processes: {len(wrong)} faults", flush=True)
    return wrong


def signals(count: int, folder: Path) -> list[str]:
    """Send signals at random times to commands that take a while: exit 130, or what it
    had come to, and nothing left.
    """
    study = folder / "study.toml"
    study.write_text(
        'scene = "steel-plane"\nalphas = 0.3\nspeeds = "0.1:0.5:20"\nphases = 4\n'
        '[[run]]\nengine = "mujoco"\nrecipe = "impulse"\ntimesteps = 1e-3\n'
    )
    model = make_model(folder)
    (folder / "h.csv").write_text("height [cm]\n30\n22\n17\n13.5\n11\n9.2\n7.8\n")
    commands = [
        ["report", str(study), "--out", str(folder / "out"), "-j", "1"],
        ["sweep", str(study), "--out", str(folder / "swept"), "--resume", "-j", "1"],
        ["measure", model, "--pair=ball,plate", "--page", str(folder / "page.html")],
        ["check", model, "--pair=ball,plate", "--restitution=0.9", "--junit", str(folder / "j.xml")],
        ["tune", "mujoco", "--alpha=0.3", "--timestep=1e-3", "--write-scene", str(folder / "s.xml")],
        ["tune", model, "--pair=ball,plate", "--alpha=0.3", "--write-model", str(folder / "m.xml")],
        ["fit", str(folder / "h.csv"), "--page", str(folder / "f.html")],
        ["law", "--alpha=0.1", "--speeds=1:2:2000", "--json"],
        ["convert", "--alpha=0.3"], ["engines"], ["pairs", model], ["paper", "--quick", "--out", str(folder / "paper"), "-j", "1"],
    ]  # fmt: skip
    for kind in _SIGNALS:  # which a job in the background may ignore, and its processes with it
        signal.signal(kind, signal.default_int_handler if kind is signal.SIGINT else signal.SIG_DFL)
    chance, wrong, codes = random.Random(1), [], Counter[int]()
    for number in range(count):
        arguments, kind = commands[number % len(commands)], chance.choice(_SIGNALS)
        with subprocess.Popen(
            [*_PROCESS, *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as process:
            time.sleep(chance.uniform(0.02, 6.0))
            process.send_signal(kind)
            try:
                _, err = process.communicate(timeout=300)
            except subprocess.TimeoutExpired:
                process.kill()
                wrong.append(_told(number, arguments, f"hung after {kind.name}", ""))
                continue
        codes[process.returncode] += 1
        # Before Python has begun to run hcbench, a signal is Python's own.
        early = process.returncode in (-kind, 130) and "Traceback" in err and "hcbench" not in err
        if (process.returncode not in (0, 1, 130, -kind)) or ("Traceback" in err and not early):
            wrong.append(
                _told(number, arguments, f"exit {process.returncode} after {kind.name}", err)
            )
        left = [p.name for p in folder.rglob(".hcbench-*") if p.name.endswith((".new", ".scratch"))]
        if left:
            wrong.append(_told(number, arguments, f"left {left} after {kind.name}", err))
    print(
        f"{count} signals: {len(wrong)} faults; exit codes {dict(sorted(codes.items()))}",
        flush=True,
    )
    return wrong


def make_model(folder: Path) -> str:
    """A sound model."""
    source = Path(__file__).parents[3] / "examples" / "good.xml"
    (folder / "good.xml").write_bytes(source.read_bytes())
    return str(folder / "good.xml")


def main() -> int:
    """Everything that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--processes", type=int, default=300)
    parser.add_argument("--signals", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0, help="number of the first input")
    parser.add_argument(
        "--seconds", type=float, default=1e9, help="of the inputs in one process, at most"
    )
    parser.add_argument("--calls", type=int, default=8000, help="of the Python API")
    parser.add_argument("--files", type=int, default=300, help="mutated files for each reader")
    parser.add_argument(
        "--readers", nargs="*", default=READERS, choices=READERS, help="of the files"
    )
    parser.add_argument("--only", type=int)
    asked = parser.parse_args()
    if asked.only is not None:
        asked.seed, asked.count, asked.processes, asked.signals = asked.only, 1, 0, 0
        asked.files = asked.calls = 0
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        os.environ["HCBENCH_DATA"] = str(folder / "data")
        deadline = time.monotonic() + asked.seconds
        wrong = in_this_process(range(asked.seed, asked.seed + asked.count), folder, deadline)
        start = asked.seed + 10_000_000
        wrong += as_processes(range(start, start + asked.processes), folder)
        wrong += signals(asked.signals, folder) if asked.signals else []
        wrong += call(range(asked.seed, asked.seed + asked.calls), folder) if asked.calls else []
        for name in asked.readers if asked.files else ():
            wrong += mutate(name, range(asked.seed, asked.seed + asked.files), folder)
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    print(f"{len(wrong)} faults in all; {used:.0f} MB at most")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
