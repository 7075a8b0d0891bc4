"""Sweeps: any size, any executor, any end; the same bytes."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
import tomllib
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

import fsspec
import numpy as np
import pandas as pd
import pytest
from sweep_engine import installed, note

from hcbench.benchmark import cluster, files, plan
from hcbench.benchmark.read import _to_digits, is_sweep, read
from hcbench.benchmark.results import RUN_KEY
from hcbench.benchmark.run import Progress, run_study, sweep
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.store import Store
from hcbench.benchmark.study import study_from
from hcbench.cli import run as cli
from hcbench.errors import CannotRun, OutputError, SettingError, UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ENGINES = {
    "scene": "steel-plane",
    "alphas": "0.004, 0.008 s/in",
    "speeds": "1:20:10 in/s",
    "loop_speeds": "4, 8 in/s",
    "phases": 4,
    "run": [
        {"engine": "reference", "recipe": "hunt-crossley", "timesteps": 1e-6},
        {"engine": "mujoco", "recipe": "spring-damper", "timesteps": "1e-5, 2e-5 s"},
        {"engine": "mujoco", "recipe": "stock", "timesteps": 2e-3},
        {"engine": "pybullet", "recipe": "restitution", "timesteps": 1e-3, "speeds": "2, 8 in/s"},
    ],
}

TESTS = [str(Path(__file__).parent), str(Path(__file__).parents[1] / "support")]


def small(
    engine: str = "reference", recipe: str = "hunt-crossley", speeds: str = "1:20 in/s"
) -> dict[str, Any]:
    return {
        "scene": "steel-plane",
        "alphas": 0.3,
        "speeds": speeds,
        "loop_speeds": "4 in/s",
        "phases": 4,
        "run": [{"engine": engine, "recipe": recipe, "timesteps": 1e-5}],
    }


@pytest.fixture(autouse=True)
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan, "_IMPACTS", 16)


def whole(folder: Path) -> dict[str, bytes]:
    """Every file's bytes, by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and "_damaged" not in path.parts
    }


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """Folders of sweeps that nothing happened to, by name."""
    folder = tmp_path_factory.mktemp("undisturbed")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "_IMPACTS", 16)
        sweep(study_from(ENGINES), folder / "engines", jobs=2)
        sweep(study_from(small()), folder / "small")
    yield {name: folder / name for name in ("engines", "small")}


# --- the table ---


def test_a_sweep_finds_what_a_run_finds(undisturbed: dict[str, Path]) -> None:
    study, folder = study_from(ENGINES), undisturbed["engines"]
    swept, ran = read(folder), run_study(study, jobs=2)
    for name in ("impacts", "loops", "scores"):
        pd.testing.assert_frame_equal(getattr(swept, name), getattr(ran, name))
    assert swept.settings == json.loads(json.dumps(ran.settings))
    assert swept.study == json.loads(json.dumps(ran.study))


BOUNCING = """scene = "steel-plane"
alphas = "0.004, 0.008 s/in"
speeds = "4, 10, 16 in/s"
loop_speeds = "10 in/s"
phases = 2
train_height = "10 mm"
train_step = "1e-3 s"
"""
BOUNCING_RUNS = (("reference", "hunt-crossley"), ("mujoco", "impulse"), ("pybullet", "restitution"))


def bouncing(*engines: str) -> str:
    """A study file whose settings at 1e-3 s are dropped under gravity too."""
    runs = [
        f'[[run]]\nengine = "{engine}"\nrecipe = "{recipe}"\ntimesteps = "1e-3, 2e-3 s"\n'
        for engine, recipe in BOUNCING_RUNS
        if engine in engines
    ]
    return "".join([BOUNCING, *runs])


def test_bounces_under_gravity_are_swept_too(tmp_path: Path) -> None:
    study = study_from(tomllib.loads(bouncing("reference", "mujoco", "pybullet")))
    sweep(study, tmp_path / "swept", jobs=2)
    swept, ran = read(tmp_path / "swept"), run_study(study)
    for name, results in (("swept.csv", swept), ("ran.csv", ran)):
        (tmp_path / name).mkdir()
        results.write(tmp_path / name)
    assert whole(tmp_path / "swept.csv") == whole(tmp_path / "ran.csv")
    assert list(swept.trains["engine"].unique()) == ["reference", "mujoco", "pybullet"]
    assert not swept.trains.duplicated([*RUN_KEY, "bounce"]).any()
    assert swept.versions == ran.versions


@pytest.mark.parametrize("harm", [Path.unlink, lambda path: path.write_bytes(b"cut")], ids=["lost", "cut"])
def test_lost_bounces_are_simulated_again(tmp_path: Path, harm: Callable[[Path], object]) -> None:
    study = study_from(tomllib.loads(bouncing("reference")))
    sweep(study, tmp_path)
    before = whole(tmp_path)
    harm(next(tmp_path.glob("_bounces-*")))
    with pytest.raises(UserError, match=r"no bounces under gravity.*--resume"):
        read(tmp_path)
    sweep(study, tmp_path, resume=True)
    assert whole(tmp_path) == before
    assert len(read(tmp_path).trains) >= 3


def test_pandas_reads_the_folder(undisturbed: dict[str, Path]) -> None:
    table, ran = pd.read_parquet(undisturbed["engines"]), read(undisturbed["engines"]).impacts
    assert list(table) == list(ran)
    key = ["engine", "setting", "alpha_s_per_m", "timestep_s", "speed_m_per_s", "phase"]
    one, other = (t.astype({"engine": str, "setting": str}).sort_values(key) for t in (table, ran))
    assert np.array_equal(_to_digits(one["restitution"].to_numpy()), other["restitution"])
    assert len(one) == 2 * 4 * 12 * 4 + 2 * 2 * 4 == len(other), (
        "both α, 12 speeds with the kept ones, 4 phases"
    )


def test_the_summary_has_a_line_for_each_setting(undisturbed: dict[str, Path]) -> None:
    summary, scores = (
        pd.read_csv(undisturbed["engines"] / "_summary.csv"),
        read(undisturbed["engines"]).scores,
    )
    assert len(summary) == len(scores) == 10
    for name in ("impacts", "parted", "rested", "failed"):
        assert summary[name].tolist() == scores[name].tolist()
    for name in ("max_error_law", "rms_error_law", "max_error_linear"):
        told = _to_digits(summary[name].to_numpy())
        assert told == pytest.approx(scores[name].to_numpy(), rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("jobs", [1, 3])
def test_the_number_of_jobs_does_not_change_a_byte(
    jobs: int, tmp_path: Path, undisturbed: dict[str, Path]
) -> None:
    sweep(study_from(ENGINES), tmp_path, jobs=jobs)
    assert whole(tmp_path) == whole(undisturbed["engines"])


def test_any_executor_does(tmp_path: Path, undisturbed: dict[str, Path]) -> None:
    study = study_from(small())
    with ThreadPoolExecutor(3) as threads:
        sweep(study, tmp_path / "threads", executor=threads)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        sweep(study, tmp_path / "processes", executor=processes)
        assert processes.submit(os.getpid).result() != os.getpid(), "it is left open"
    for name in ("threads", "processes"):
        assert whole(tmp_path / name) == whole(undisturbed["small"])


def test_what_a_study_asks_wrongly_is_said_before_anything_is_made(tmp_path: Path) -> None:
    wrong = {**ENGINES, "run": [{"engine": "mujoco", "recipe": "nothing", "timesteps": 1e-6}]}
    with pytest.raises(UserError, match="nothing"):
        sweep(study_from(wrong), tmp_path / "out")
    assert not (tmp_path / "out" / "_sweep.json").exists()


def test_progress_counts_up_to_all_impacts(tmp_path: Path) -> None:
    seen: list[Progress] = []
    end = sweep(study_from(small()), tmp_path, progress=seen.append)
    assert [p.impacts for p in seen] == sorted(p.impacts for p in seen)
    assert (seen[0].impacts, seen[-1].impacts, end.of) == (0, 80, 80)
    assert end == seen[-1]


def test_the_summary_can_be_opened_while_it_runs(tmp_path: Path) -> None:
    seen = []

    def look(now: Progress) -> None:
        summary = pd.read_csv(tmp_path / "_summary.csv")
        seen.append(int(summary["impacts"].sum()))
        assert 0 < len(pd.read_parquet(tmp_path)) == now.impacts or now.impacts == 0

    sweep(study_from(small()), tmp_path, progress=look)
    assert seen[0] == 0
    assert pd.read_csv(tmp_path / "_summary.csv")["impacts"].sum() == 80


# --- any end ---

KILLED = """
import sys
sys.path[:0] = {tests!r}
sys.path.insert(0, {package!r})
from hcbench.benchmark import plan
from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import study_from
from test_sweep import small
plan._IMPACTS = 16
sweep(study_from(small("tripping", "law")), {folder!r}, jobs=2, resume=True)
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "package"
    folder.mkdir()
    yield from (folder for _ in installed(folder, monkeypatch))


def test_killed_at_any_moment_and_resumed_it_is_as_if_nothing_had_been(tmp_path: Path, package: Path) -> None:
    study, killed = study_from(small("tripping", "law")), tmp_path / "killed"
    log = tmp_path / "log"
    note(package, log=str(log), sleep=0.3)
    script = KILLED.format(tests=TESTS, package=str(package), folder=str(killed))
    for parts_wanted in (1, 3):
        with subprocess.Popen([sys.executable, "-c", script]) as process:
            until(lambda: len(list(killed.glob("part-*"))) >= parts_wanted, process)  # noqa: B023
            process.send_signal(signal.SIGKILL)
    note(package, log=str(log))
    before = {path.name: path.stat().st_mtime_ns for path in killed.glob("part-*")}
    assert 3 <= len(before) < 5
    (killed / ".part-0000004-0123456789abcdef.parquet.new").write_bytes(b"what the killed one was writing")
    end = sweep(study, killed, jobs=2, resume=True)
    assert end.resumed == len(before)
    assert {n: (killed / n).stat().st_mtime_ns for n in before} == before, (
        "what is there is not written again"
    )
    flown = log.read_text().splitlines()
    assert len(set(flown)) == 80
    assert len(flown) - 80 <= 2 * 2 * 16, "at most the parts in flight, of two jobs, killed twice"
    note(package)
    sweep(study, tmp_path / "whole")
    assert whole(killed) == whole(tmp_path / "whole")


def until(so: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + 60
    while not so():
        assert time.monotonic() < end
        assert process.poll() is None
        time.sleep(0.02)


def test_an_interrupt_leaves_whole_parts_and_no_process(tmp_path: Path, package: Path) -> None:
    note(package, sleep=0.3)
    folder = tmp_path / "stopped"
    script = KILLED.format(tests=TESTS, package=str(package), folder=str(folder))
    script += "raise SystemExit('not interrupted')"
    with subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.PIPE) as process:
        until(lambda: len(list(folder.glob("part-*"))) >= 1, process)
        running = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
        children = [pid for pid in running if parent(pid) == process.pid]
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=20)
    assert b"KeyboardInterrupt" in error
    assert children
    assert not any(Path(f"/proc/{child}").exists() for child in children)
    note(package)
    assert sweep(study_from(small("tripping", "law")), folder, resume=True).resumed >= 1


def parent(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


def test_resuming_what_is_finished_does_nothing(tmp_path: Path) -> None:
    sweep(study_from(small()), tmp_path)
    before = whole(tmp_path)
    end = sweep(study_from(small()), tmp_path, resume=True)
    assert (end.resumed, end.shards) == (5, 5)
    assert whole(tmp_path) == before


def test_resume_begins_where_there_is_nothing(tmp_path: Path, undisturbed: dict[str, Path]) -> None:
    sweep(study_from(small()), tmp_path / "new", resume=True)
    assert whole(tmp_path / "new") == whole(undisturbed["small"])


@pytest.mark.parametrize(
    "harm",
    [
        lambda path: path.write_bytes(path.read_bytes()[:-7]),
        lambda path: path.write_bytes(b""),
        lambda path: path.write_bytes(path.read_bytes().replace(b"reference", b"r3ference", 1)),
    ],
    ids=["cut short", "emptied", "edited"],
)
@pytest.mark.parametrize("which", ["part-0000001-*", "_loops/*"])
def test_a_damaged_part_is_put_aside_and_flown_again(
    tmp_path: Path, harm: Callable[[Path], None], which: str
) -> None:
    sweep(study_from(small()), tmp_path)
    before = whole(tmp_path)
    victim = next(iter(tmp_path.glob(which)))
    harm(victim)
    if victim.read_bytes() == before[str(victim.relative_to(tmp_path))]:
        victim.write_bytes(victim.read_bytes()[::-1])
    with pytest.raises(UserError, match=r"cut short or edited.*--resume"):
        read(tmp_path)
    end = sweep(study_from(small()), tmp_path, resume=True)
    assert len(end.damaged) == 1
    assert (end.resumed, end.shards) == (4, 5)
    assert whole(tmp_path) == before
    assert len(list((tmp_path / "_damaged").iterdir())) == 1
    assert len(read(tmp_path).impacts) == 80


def test_a_part_under_another_s_number_is_flown_again(tmp_path: Path) -> None:
    sweep(study_from(small()), tmp_path)
    before = whole(tmp_path)
    first, second = sorted(tmp_path.glob("part-*"))[:2]
    second.write_bytes(first.read_bytes())
    second.rename(tmp_path / first.name.replace("0000000", "0000001"))
    with pytest.raises(UserError, match=r"cut short or edited.*--resume"):
        read(tmp_path)
    assert sweep(study_from(small()), tmp_path, resume=True).damaged == (1,)
    assert whole(tmp_path) == before


@pytest.mark.parametrize(
    "name", ["part-0000099-{}.parquet", "part-0000000-0123456789abcdef.parquet", "x.parquet"]
)
def test_a_table_that_is_no_part_is_named_and_left_alone(tmp_path: Path, name: str) -> None:
    sweep(study_from(small()), tmp_path)
    part = min(tmp_path.glob("part-*"))
    stranger = tmp_path / name.format(part.stem[-16:])
    stranger.write_bytes(part.read_bytes())
    before = whole(tmp_path)
    for go in (lambda: sweep(study_from(small()), tmp_path, resume=True), lambda: read(tmp_path)):
        with pytest.raises(UserError, match=r"holds 'part-|holds 'x"):
            go()
    assert whole(tmp_path) == before


def test_a_lost_loop_file_is_flown_again(tmp_path: Path) -> None:
    sweep(study_from(small()), tmp_path)
    before = whole(tmp_path)
    next(iter((tmp_path / "_loops").iterdir())).unlink()
    assert len(sweep(study_from(small()), tmp_path, resume=True).damaged) == 1
    assert whole(tmp_path) == before


# --- folders that are not what they should be ---


def test_a_folder_of_a_sweep_is_not_taken_without_resume(tmp_path: Path) -> None:
    sweep(study_from(small()), tmp_path)
    with pytest.raises(UserError, match=r"holds a sweep already.*--resume"):
        sweep(study_from(small()), tmp_path)


def test_another_study_does_not_get_mixed_in(tmp_path: Path) -> None:
    sweep(study_from(small()), tmp_path)
    before = whole(tmp_path)
    for change in ({"alphas": 0.2}, {"phases": 8}, {"gravity": 9.8}, {"title": "other"}):
        (name,) = change
        with pytest.raises(UserError, match=f"another sweep: {name}"):
            sweep(study_from({**small(), **change}), tmp_path, resume=True)
    assert whole(tmp_path) == before


def test_another_version_does_not_get_mixed_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep(study_from(small()), tmp_path)
    real = plan.versions_here
    monkeypatch.setattr(plan, "versions_here", lambda *engines: {**real(*engines), "numpy": "9.9"})
    with pytest.raises(UserError, match=rf"numpy {np.__version__} instead of 9\.9"):
        sweep(study_from(small()), tmp_path, resume=True)


def test_an_edited_scene_does_not_get_mixed_in(tmp_path: Path) -> None:
    source = Path(__file__).parents[2] / "scenes" / "steel-plane"
    scene = tmp_path / "mine"
    scene.mkdir()
    for file in source.iterdir():
        (scene / file.name).write_bytes(file.read_bytes())
    study = {**small("mujoco", "spring-damper"), "scene": str(scene)}
    sweep(study_from(study), tmp_path / "out")
    (scene / "scene.xml").write_text((scene / "scene.xml").read_text().replace("0.85", "0.86"))
    with pytest.raises(UserError, match="the scene's files differ"):
        sweep(study_from(study), tmp_path / "out", resume=True)


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(UserError, match=r"holds 'thesis\.txt' and no sweep"):
        sweep(study_from(small()), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_folder_of_a_later_hcbench_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "_sweep.json").write_text('{"kind": "hcbench sweep", "schema": 9}')
    with pytest.raises(UserError, match="schema 9; expected schema 1"):
        sweep(study_from(small()), tmp_path, resume=True)


def test_two_sweeps_do_not_write_to_one_folder(tmp_path: Path) -> None:
    said = f"another sweep, process {os.getpid()} on .*is writing there"
    with Store(files.open_files(str(tmp_path))).locked(), pytest.raises(CannotRun, match=said):
        sweep(study_from(small()), tmp_path)
    sweep(study_from(small()), tmp_path)
    assert not (tmp_path / "_lock").exists()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for where in (tmp_path / "file" / "out", Path("/proc/out")):
        with pytest.raises(OutputError, match="folder"):
            sweep(study_from(small()), where)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EIO])
def test_a_full_disk_loses_nothing(
    tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch, undisturbed: dict[str, Path]
) -> None:
    real, left = files.LocalFiles.write, [4]

    def write(self: files.LocalFiles, name: str, content: bytes) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(code, os.strerror(code))
        real(self, name, content)

    monkeypatch.setattr(files.LocalFiles, "write", write)
    with pytest.raises(OutputError, match=rf"{os.strerror(code)}.*--resume"):
        sweep(study_from(small()), tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(plan, "_IMPACTS", 16)
    end = sweep(study_from(small()), tmp_path, resume=True)
    assert 0 < end.resumed < 5
    assert whole(tmp_path) == whole(undisturbed["small"])


def test_a_file_that_cannot_be_written_whole_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        files.open_files(str(tmp_path)).write("x", b"content")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full() -> dict[str, Any]:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(files, "_myself", full)
    with pytest.raises(OutputError, match="No space left"):
        sweep(study_from(small()), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_read_wants_a_finished_sweep(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="holds no sweep"):
        read(tmp_path)
    assert not is_sweep(tmp_path)
    sweep(study_from(small()), tmp_path)
    assert is_sweep(tmp_path)
    next(iter(tmp_path.glob("part-*"))).unlink()
    with pytest.raises(UserError, match=r"holds 4 of 5 parts.*--resume"):
        read(tmp_path)


# --- places that fsspec knows ---


def test_a_folder_can_be_anywhere_that_fsspec_opens(undisturbed: dict[str, Path], tmp_path: Path) -> None:
    memory = fsspec.filesystem("memory")
    sweep(study_from(small()), "memory://bucket/sweep")
    found = {
        str(Path(path).relative_to("/bucket/sweep")): memory.cat_file(path)
        for path in memory.find("/bucket/sweep")
    }
    assert found == whole(undisturbed["small"])
    memory.pipe_file("/bucket/sweep/" + next(n for n in found if n.startswith("part-0000002")), b"cut")
    end = sweep(study_from(small()), "memory://bucket/sweep", resume=True)
    assert end.damaged == (2,)
    assert memory.find("/bucket/sweep/_damaged")
    pd.testing.assert_frame_equal(read("memory://bucket/sweep").impacts, read(undisturbed["small"]).impacts)
    sweep(study_from(small()), f"file://{tmp_path}/shared")
    assert whole(tmp_path / "shared") == whole(undisturbed["small"])
    with pytest.raises(UserError, match="nowhere://x"):
        sweep(study_from(small()), "nowhere://x")


def test_there_a_lock_is_given_up_when_nobody_keeps_it_fresh() -> None:
    memory = fsspec.filesystem("memory")
    old = {"host": "far", "pid": 1, "time": time.time() - 1000, "token": "x"}
    memory.pipe_file("/locked/_lock", json.dumps({**old, "time": time.time()}).encode())
    with pytest.raises(CannotRun, match="process 1 on far"):
        sweep(study_from(small()), "memory://locked", resume=True)
    memory.pipe_file("/locked/_lock", json.dumps(old).encode())
    assert sweep(study_from(small()), "memory://locked", resume=True).shards == 5
    assert not memory.exists("/locked/_lock")


# --- engines that fail ---


def test_what_an_engine_dies_on_is_a_row_with_the_reason(tmp_path: Path, package: Path) -> None:
    study = study_from(small("tripping", "law"))
    phases = [(i + 0.5) / 4 for i in range(4)]
    at = [[study.speeds[i], phase] for i in (2, 10, 15) for phase in phases]
    note(package, segfault=at[:4], memory=at[4:8], error=at[8:])  # all phases of a speed, as such things go
    sweep(study, tmp_path / "out", jobs=2)
    table = read(tmp_path / "out").impacts
    lost = table[table["status"] == "crashed"]
    assert lost[["speed_m_per_s", "phase"]].to_numpy().tolist() == at
    reasons = lost["reason"].tolist()
    assert set(reasons[:4]) == {"crashed with SIGSEGV"}
    assert set(reasons[4:8]) == {"MemoryError"}
    assert set(reasons[8:]) == {"RuntimeError: the solver lost its way"}
    note(package)
    sweep(study, tmp_path / "well")
    kept = table["status"] != "crashed"
    pd.testing.assert_frame_equal(table[kept], read(tmp_path / "well").impacts[kept])
    summary = pd.read_csv(tmp_path / "out" / "_summary.csv")
    assert (summary["parted"].item(), summary["failed"].item()) == (68, 12)


def test_what_an_engine_hangs_on_is_a_row_with_the_reason(tmp_path: Path, package: Path) -> None:
    study = study_from(small("tripping", "law"))
    note(package, hang=[[study.speeds[6], 0.375]])
    sweep(study, tmp_path, jobs=2, timeouts=Timeouts(start=8.0, each=0.0))  # what else it flies takes 0.1 s
    table = read(tmp_path).impacts
    lost = table[table["status"] == "crashed"]
    assert lost[["speed_m_per_s", "phase", "reason"]].to_numpy().tolist() == [
        [study.speeds[6], 0.375, "no answer within 8 s"]
    ]


def test_a_setting_that_the_engine_refuses_stops_the_sweep(tmp_path: Path) -> None:
    study = {**small("mujoco", "staggered"), "scene": "steel-cup"}
    with pytest.raises(SettingError, match="cup"):
        sweep(study_from(study), tmp_path)


class Failing(ThreadPoolExecutor):
    """Fails each task so many times before it runs it."""

    def __init__(self, times: int) -> None:
        super().__init__(2)
        self._times: dict[int, int] = {}
        self._most = times

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        number = args[0].number
        self._times[number] = self._times.get(number, 0) + 1
        if self._times[number] > self._most:
            return super().submit(fn, *args, **kwargs)
        failed: Future[Any] = Future()
        failed.set_exception(ConnectionError("the machine\nwent away"))
        return failed


def test_a_part_that_an_executor_failed_is_asked_for_again(
    tmp_path: Path, undisturbed: dict[str, Path]
) -> None:
    with Failing(1) as executor:
        sweep(study_from(small()), tmp_path, executor=executor)
    assert whole(tmp_path) == whole(undisturbed["small"])


def test_an_executor_that_keeps_failing_is_one_line(tmp_path: Path) -> None:
    with (
        Failing(9) as executor,
        pytest.raises(CannotRun, match=r"part \d 2 times: ConnectionError: the machine went away.*--resume"),
    ):
        sweep(study_from(small()), tmp_path / "failing", executor=executor)
    with ThreadPoolExecutor(1) as closed:
        pass
    with pytest.raises(CannotRun, match=r"executor: .*shutdown.*--resume"):
        sweep(study_from(small()), tmp_path / "closed", executor=closed)


def test_a_worker_with_something_else_installed_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from hcbench.benchmark import shard

    other = {"hcbench": "0.0.1", "numpy": np.__version__}
    monkeypatch.setattr(shard, "versions_here", lambda *engines: other)
    with pytest.raises(CannotRun, match=r"worker: has hcbench 0\.0\.1; expected hcbench .*same everywhere"):
        sweep(study_from(small()), tmp_path)


# --- the command ---


def test_the_command_sweeps_resumes_and_reports(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "balls").mkdir()
    monkeypatch.chdir(tmp_path / "balls")
    Path("study.toml").write_text(
        'scene = "steel-plane"\nalphas = 0.3\nspeeds = "1:20 in/s"\nphases = 4\nloop_speeds = "4 in/s"\n'
        '[[run]]\nengine = "reference"\nrecipe = "hunt-crossley"\ntimesteps = 1e-5\n'
    )
    assert cli(["sweep", "study.toml", "--out", "swept", "--jobs", "1"]) == 0
    assert capsys.readouterr().out == "swept\n"
    assert cli(["sweep", "study.toml", "--out", "swept"]) == 2
    assert "--resume" in capsys.readouterr().err
    Path("bouncing.toml").write_text(bouncing("reference", "mujoco"))
    assert cli(["sweep", "bouncing.toml", "--out", "bounced", "--jobs", "2"]) == 0
    min(Path("bounced").glob("part-*")).write_bytes(b"")
    capsys.readouterr()
    assert cli(["sweep", "bouncing.toml", "--out", "bounced", "--resume"]) == 0
    assert "part 0 was cut short or edited" in capsys.readouterr().err
    assert cli(["report", "bounced", "--out", "of-a-sweep"]) == 0
    assert "Restitution" in Path("of-a-sweep/index.html").read_text(encoding="utf-8")
    assert cli(["report", "bouncing.toml", "--out", "of-a-run"]) == 0
    assert whole(Path("of-a-sweep")) == whole(Path("of-a-run"))
    assert cli(["sweep", "nowhere.toml"]) == 2
    capsys.readouterr()
    assert cli(["sweep", "study.toml", "--jobs", "1"]) == 0
    assert cli(["report", "study.toml", "--quick", "--jobs", "1"]) == 0
    assert capsys.readouterr().out.split() == ["sweeps/balls", "reports/balls/index.html"]


# --- a cluster ---

CLUSTER = """
import logging, os, sys
sys.path[:0] = {tests!r}
sys.path.insert(0, {package!r})
import hcbench
from distributed import Client, LocalCluster
from hcbench.errors import CannotRun
from hcbench.benchmark.study import study_from
from hcbench.benchmark import plan
from hcbench.benchmark.run import sweep
from test_sweep import small

if __name__ == "__main__":
    logging.disable(logging.WARNING)
    plan._IMPACTS = 16
    study = study_from(small("tripping", "law"))
    with LocalCluster(2, threads_per_worker=1, protocol="tcp://", dashboard_address=None) as workers:
        address = workers.scheduler_address
        pids = [worker.pid for worker in workers.workers.values()]
        killed = []
        def kill(now):
            if now.shards == 1 and not killed:
                with Client(address, set_as_default=False) as client:
                    one = next(iter(client.run(os.getpid).values()))
                killed.append(one)
                os.kill(one, 9)
        end = sweep(study, "file://" + {folder!r}, scheduler=address, progress=kill)
        assert killed and end.shards == 5, (killed, end)
        hcbench.__version__ = "9.9"
        try:
            sweep(study, {folder!r} + "-other", scheduler=address)
        except CannotRun as error:
            print(error)
"""


def test_a_dask_cluster_that_loses_a_worker_leaves_the_same_bytes(tmp_path: Path, package: Path) -> None:
    pytest.importorskip("distributed")
    note(package, sleep=0.2)
    script = CLUSTER.format(tests=TESTS, package=str(package), folder=str(tmp_path / "cluster"))
    path = tmp_path / "run_cluster.py"
    path.write_text(script)
    done = subprocess.run(
        [sys.executable, str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "has hcbench" in done.stdout and "expected hcbench 9.9" in done.stdout
    sweep(study_from(small("tripping", "law")), tmp_path / "whole")
    assert whole(tmp_path / "cluster") == whole(tmp_path / "whole")


def test_a_scheduler_that_is_not_there_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr(cluster, "_CONNECT_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense", "tcp://nonsense", "''"):
        with pytest.raises(CannotRun, match=f"{address} does not answer"):
            sweep(study_from(small()), tmp_path / "out", scheduler=address.strip("'"))


def test_without_dask_it_says_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(CannotRun, match=r"pip install 'hcbench\[cluster\]'"):
        sweep(study_from(small()), tmp_path, scheduler="tcp://127.0.0.1:8786")
