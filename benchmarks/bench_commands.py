"""Waiting times of a user: imports, help, the default report, one tune,
a sweep on one job and on two.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import load_study

HCBENCH = str(Path(sys.executable).with_name("hcbench"))
# As it was released, so that runs years apart compare.
FIRST_RELEASE = str(Path(__file__).with_name("first_release.toml"))


def took(*command: str) -> float:
    """Seconds of a command."""
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - began


def processor(*command: str, code: int = 0) -> float:
    """Seconds of a processor that a command and its workers take until it exits with a code."""
    before = os.times()
    assert subprocess.run(command, capture_output=True, check=False).returncode == code
    after = os.times()
    return (
        after.children_user + after.children_system - before.children_user - before.children_system
    )


def test_import(beside: Any) -> None:
    python = sys.executable
    beside(
        "import hcbench",
        {
            "python -c pass": lambda: took(python, "-c", "pass"),
            "hcbench": lambda: took(python, "-c", "import hcbench"),
        },
        must="0.3 s",
        aim="0.1 s",
    )


def test_help(beside: Any) -> None:
    beside(
        "hcbench --help", {"hcbench": lambda: took(HCBENCH, "--help")}, must="0.5 s", aim="0.2 s"
    )


@pytest.mark.parametrize(
    ("study", "words", "must", "aim"),
    [
        ("the study of the first release", [FIRST_RELEASE], "15 s", "10 s"),
        ("the default study", [], "14 s", "6 s"),
        ("the default study, --quick", ["--quick"], "5 s", "2.5 s"),
    ],
)
def test_a_report(
    beside: Any, tmp_path: Path, study: str, words: list[str], must: str, aim: str
) -> None:
    command = [HCBENCH, "report", *words, "--out", str(tmp_path / "report")]
    beside(
        f"hcbench report, {study}",
        {"hcbench": lambda: took(*command)},
        rounds=1,
        must=must,
        aim=aim,
    )


MODEL = "scenes/steel-plane/scene.xml"
PAIR = (MODEL, "--pair", "ball,plate")
MEASURED = (*PAIR, "--speeds", "0.1, 0.3 m/s")
QUADRUPED = "examples/quadruped.xml"
FOOT = (QUADRUPED, "--pair", "left_front_foot,floor")
FEET = [f"{side}_{end}_foot,floor" for side in ("left", "right") for end in ("front", "hind")]
DRAW = ("randomize", QUADRUPED, *(word for foot in FEET for word in ("--pair", foot)))
TUNE = ("tune", "mujoco", "--alpha", "0.3 s/m", "--timestep", "2 ms")
FINE = ("tune", "mujoco", "--alpha", "0.008 s/in", "--timestep", "10 us")
# Its settings land worse than the model as it is: the command ends with exit code 1.
LANDS_WORSE = ("tune", *FOOT, "--alpha", "0.3 s/m")
LONG_S = 3.0  # a command that may take longer is measured twice in place of four times


@pytest.mark.parametrize(
    ("words", "of", "must", "aim"),
    [
        (("check", *MEASURED, "--restitution", "0.5", "--max-error", "1"), "", "0.6 s", "0.4 s"),
        (("measure", *MEASURED), "", "0.55 s", "0.4 s"),
        (("measure", *PAIR, "--alpha", "0.3 s/m"), "--alpha, 8 speeds", "0.65 s", "0.45 s"),
        (("measure", *FOOT, "--alpha", "0.3 s/m"), "of README's quadruped", "0.9 s", "0.6 s"),
        (("pairs", MODEL), "", "0.5 s", "0.4 s"),
        (("land", QUADRUPED), "of README's quadruped", "0.8 s", "0.6 s"),
        (("law", "--alpha", "0.008 s/in", "--speed", "8 in/s"), "", "0.2 s", "0.15 s"),
        (("convert", "--alpha", "0.008 s/in"), "", "0.4 s", "0.2 s"),
        (("tune", "mujoco", "--alpha", "0.008 s/in", "--timestep", "1e-3"), "", "2 s", "0.7 s"),
        (TUNE, "mujoco at 2 ms, all kinds", "1.5 s", "0.8 s"),
        ((*TUNE, "--plugin"), "--plugin", "0.8 s", "0.4 s"),
        (LANDS_WORSE, "of README's quadruped, a foot", "15 s", "2 s"),
        (FINE, "mujoco at 10 µs, where a body is followed for 400 000 steps", "8 s", "1 s"),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else "",
)
def test_processor_time_of_a_command(
    beside: Any, words: tuple[str, ...], of: str, must: str, aim: str
) -> None:
    """Processor time of a command and its workers; most of it is imports."""
    what = f"{' '.join(filter(None, ['hcbench', words[0], of]))}, processor time"
    long = float(must.removesuffix(" s")) > LONG_S
    beside(
        what,
        {"hcbench": lambda: processor(HCBENCH, *words, code=int(words == LANDS_WORSE))},
        rounds=1 if long else 3,
        must=must,
        aim=aim,
    )


def share_of_steps(*words: str) -> float:
    """Processor time that a command spends in its engines' steps, per cent of all of its own."""
    command = [sys.executable, str(Path(__file__).with_name("_stepping.py")), *words]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds = json.loads(done.stdout)
    return 100 * float(seconds["stepping"]) / float(seconds["whole"])


BALL, ROBOT = "70 %", "50 %"
DROPS = "drops of a ball, spring-damper"


@pytest.mark.parametrize(
    ("what", "words", "aim"),
    [
        ("tune mujoco at 2 ms, a ball, boxes and a capsule", TUNE, BALL),
        ("tune mujoco at 10 µs, a ball, boxes and a capsule", FINE, BALL),
        ("measure of the scene's ball, 8 speeds", ("measure", *PAIR, "--alpha", "0.3 s/m"), BALL),
        ("report --quick, the default study", ("report", "--quick", "--jobs", "1"), BALL),
        (f"sweep of 100 000 {DROPS}, 1 ms", ("sweep", "1 ms", "100_000"), BALL),
        (f"sweep of 16 000 {DROPS}, 1 µs", ("sweep", "1 µs", "16_000"), BALL),
        ("measure of README's quadruped, a foot", ("measure", *FOOT, "--alpha", "0.3 s/m"), ROBOT),
        ("land of README's quadruped", ("land", QUADRUPED), ROBOT),
        ("tune of README's quadruped, a foot", ("tune", *FOOT, "--alpha", "0.3 s/m"), ROBOT),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_the_share_of_steps(
    benchmark: Any, tmp_path: Path, what: str, words: tuple[str, ...], aim: str
) -> None:
    """Processor time in the engines' steps over all of it, Python's start and imports included."""
    if words[0] == "sweep":
        _, timestep, impacts = words
        study = impacts_study(tmp_path / "study.toml", int(impacts), timestep)
        words = ("sweep", str(study), "--jobs", "1")
    if words[0] in ("sweep", "report"):
        words = (*words, "--out", str(tmp_path / "out"))
    shares: list[float] = []
    benchmark.pedantic(lambda: shares.append(share_of_steps(*words)), rounds=1)
    benchmark.extra_info.update(
        what=f"the engine's steps over processor time: {what}",
        unit="%",
        seconds={"hcbench": shares[0]},
        must="",
        aim=aim,
    )


@pytest.mark.parametrize(
    ("what", "bands", "code", "must", "aim"),
    [
        # Two cores that idle have 120 s in a minute.
        ("4096 worlds", ("--restitution", "0.3:0.6", "--friction", "0.5:1"), 0, "120 s", "20 s"),
        ("a band out of reach", ("--restitution", "0.01:0.9"), 2, "10 s", "5 s"),
    ],
)
def test_processor_time_of_drawing_worlds(
    beside: Any, what: str, bands: tuple[str, ...], code: int, must: str, aim: str
) -> None:
    """Processor time of `randomize` with the four feet of README's quadruped."""
    draw = {"hcbench": lambda: processor(HCBENCH, *DRAW, *bands, code=code)}
    what = f"hcbench randomize of four feet, {what}, processor time"
    beside(what, draw, rounds=1, must=must, aim=aim)


def test_processor_time_of_a_fit(beside: Any, tmp_path: Path) -> None:
    """Processor time of `fit` with a table of five impacts."""
    table = tmp_path / "speeds.csv"
    pairs = ["0.2,0.19", "0.4,0.36", "0.8,0.64", "1.2,0.9", "1.6,1.1"]
    table.write_text("\n".join(["v_in (m/s),v_out (m/s)", *pairs]))
    fit = {"hcbench": lambda: processor(HCBENCH, "fit", str(table))}
    beside("hcbench fit of a table, processor time", fit, rounds=3, must="0.65 s", aim="0.5 s")


def test_processor_time_of_a_fit_of_sound(beside: Any) -> None:
    """Processor time of `fit` with the tutorial's recording of a drop."""
    fit = {"hcbench": lambda: processor(HCBENCH, "fit", "examples/recording/drop.wav")}
    beside("hcbench fit of a sound, processor time", fit, rounds=2, must="2.5 s", aim="1.5 s")


@pytest.mark.parametrize(
    ("what", "file", "pair", "must", "aim"),
    [
        ("a sphere", "sphere2.urdf", "sphere2.urdf,plane.urdf", "1.5 s", "0.8 s"),
        ("Laikago, a toe", "laikago/laikago_toes.urdf", "toeRL,planeLink", "4 s", "3 s"),
    ],
)
def test_processor_time_of_measuring_a_urdf(
    beside: Any, what: str, file: str, pair: str, must: str, aim: str
) -> None:
    """Processor time of `measure`, with its search for causes, in files of pybullet_data."""
    data = Path(pytest.importorskip("pybullet_data").getDataPath())
    words = ("measure", str(data / file), str(data / "plane.urdf"), "--pair", pair)
    beside(
        f"hcbench measure in PyBullet, {what}, processor time",
        {"hcbench": lambda: processor(HCBENCH, *words)},
        rounds=2,
        must=must,
        aim=aim,
    )


def impacts_study(path: Path, impacts: int, timestep: str, recipe: str = "spring-damper") -> Path:
    """Write a study of so many impacts of a ball in MuJoCo; return its path."""
    speeds = min(impacts // 32, 31_250)
    phases = impacts // (4 * speeds)
    path.write_text(
        'scene = "steel-plane"\nalphas = "0.002, 0.004, 0.008, 0.016 s/in"\n'
        f'speeds = "1:20:{speeds} in/s"\nphases = {phases}\n'
        f'[[run]]\nengine = "mujoco"\nrecipe = "{recipe}"\ntimesteps = "{timestep}"\n'
    )
    return path


def test_processor_time_of_a_million_drops(beside: Any, tmp_path: Path) -> None:
    """Processor time of all of them, from start to folder."""
    study = impacts_study(tmp_path / "study.toml", 1_000_000, "1 ms")
    number = iter(range(99))

    def swept_once() -> float:
        return processor(HCBENCH, "sweep", str(study), "--out", str(tmp_path / str(next(number))))

    what = "a million drops, MuJoCo at 1 ms, processor time"
    beside(what, {"hcbench": swept_once}, rounds=1, must="20 s", aim="7 s")


def test_two_jobs_over_one(beside: Any, tmp_path: Path) -> None:
    study = load_study(impacts_study(tmp_path / "study.toml", 120_000, "1 µs"))
    number = iter(range(99))

    def sweeping(jobs: int) -> None:
        sweep(study, tmp_path / str(next(number)), jobs=jobs)

    beside(
        "a sweep of 120 000 impacts, MuJoCo at 1 µs, per impact",
        {"one job": lambda: sweeping(1), "hcbench": lambda: sweeping(2)},
        per=120_000,
        rounds=1,
        must="1.9",
        aim="1.95",
    )


IMPACTS = int(os.environ.get("HCBENCH_BENCH_IMPACTS", "1_000_000"))


def peak_of(*command: str) -> float:
    """Peak memory of a command and its workers, MiB, looked at every 20 ms: proportional set size,
    so that shared pages count once.
    """
    peak = 0.0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        while process.poll() is None:
            peak = max(peak, memory(process.pid))
            time.sleep(0.02)
    assert process.returncode == 0
    return peak


def swept_peak(impacts: int, folder: Path) -> float:
    """Peak memory of a sweep of so many impacts into a folder, by two jobs, MiB."""
    study = impacts_study(folder.with_suffix(".toml"), impacts, "1 ms", "impulse")
    return peak_of(HCBENCH, "sweep", str(study), "--out", str(folder), "--jobs", "2")


def test_memory_of_a_sweep(benchmark: Any, tmp_path: Path) -> None:
    """Peak memory of the command, its processes' together."""
    peaks: list[float] = []
    folder = tmp_path / "sweep"
    benchmark.pedantic(lambda: peaks.append(swept_peak(IMPACTS, folder)), rounds=1)
    seconds = benchmark.stats.stats.min / IMPACTS
    benchmark.extra_info.update(
        what=f"memory of a sweep of {IMPACTS:,} impacts, two jobs",
        unit="MiB",
        seconds={"hcbench": max(peaks)},
        also=f"{seconds * 1e6:.0f} µs an impact",
        must="200 MiB",
        aim="",
    )


def test_memory_of_a_report(benchmark: Any, tmp_path: Path) -> None:
    """Memory of a report of so many impacts, and of ten times as many by its slope from a quarter."""
    peaks: dict[int, float] = {}
    for impacts in (IMPACTS // 4, IMPACTS):
        swept_peak(impacts, tmp_path / str(impacts))

    def run() -> None:
        for impacts in (IMPACTS // 4, IMPACTS):
            words = (str(tmp_path / str(impacts)), "--out", str(tmp_path / f"{impacts}-report"))
            peaks[impacts] = peak_of(HCBENCH, "report", *words, "--jobs", "2")

    benchmark.pedantic(run, rounds=1)
    few, most = peaks.values()
    slope = (most - few) / (IMPACTS - IMPACTS // 4)
    benchmark.extra_info.update(
        what=f"memory of a report of {10 * IMPACTS:,} impacts, two jobs",
        unit="MiB",
        seconds={"hcbench": most + slope * 9 * IMPACTS},
        also=f"extrapolated; of {IMPACTS:,}: {most:.0f} MiB",
        must="1 GiB",
        aim="",
    )


def memory(of: int) -> float:
    """Memory of a process, by its id, and its children, MiB."""
    total = 0
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit() and (int(entry.name) == of or parent(entry) == of):
            with suppress(OSError):  # ended meanwhile
                lines = (entry / "smaps_rollup").read_text().splitlines()
                total += next(
                    (int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0
                )
    return total / 1024


def parent(entry: Path) -> int:
    try:
        return int((entry / "stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0
