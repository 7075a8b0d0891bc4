"""A sweep that was killed, interrupted or damaged is resumed to the same bytes."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from in_place import in_place
from small_sweeps import TESTS, small, until, whole
from sweep_engine import note

from hcbench.benchmark.read import read
from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import study_from
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.usefixtures("small_parts")


KILLED = """
import sys
sys.path[:0] = {tests!r}
sys.path.insert(0, {package!r})
from hcbench.benchmark import plan
from hcbench.benchmark.run import sweep
from hcbench.benchmark.study import study_from
from small_sweeps import small
plan.SHARD_IMPACTS = 16
sweep(study_from(small("tripping", "law")), {folder!r}, jobs=2, resume=True)
"""


def test_killed_at_any_moment_and_resumed_it_is_as_if_nothing_had_been(
    tmp_path: Path, package: Path
) -> None:
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
    (killed / ".part-0000004-0123456789abcdef.parquet.new").write_bytes(
        b"what the killed one was writing"
    )
    end = sweep(study, killed, jobs=2, resume=True)
    assert end.resumed == len(before)
    assert {n: (killed / n).stat().st_mtime_ns for n in before} == before, (
        "what is there is not written again"
    )
    simulated = log.read_text().splitlines()
    assert len(set(simulated)) == 80
    # Workers finish what they were handed before they see that the run has gone: two parts each.
    handed_out = 2 * 2 * 16
    assert len(simulated) - 80 <= 2 * handed_out, "killed twice"
    note(package)
    with in_place():
        sweep(study, tmp_path / "whole")
    assert whole(killed) == whole(tmp_path / "whole")


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
    with in_place():
        assert sweep(study_from(small("tripping", "law")), folder, resume=True).resumed >= 1


def parent(process: int) -> int:
    try:
        return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])
    except OSError:
        return 0


@pytest.mark.usefixtures("without_processes")
def test_resuming_what_is_finished_does_nothing(tmp_path: Path, undisturbed: Path) -> None:
    shutil.copytree(undisturbed, tmp_path, dirs_exist_ok=True)
    before = whole(tmp_path)
    end = sweep(study_from(small()), tmp_path, resume=True)
    assert (end.resumed, end.shards) == (5, 5)
    assert whole(tmp_path) == before


def test_resume_begins_where_there_is_nothing(tmp_path: Path, undisturbed: Path) -> None:
    sweep(study_from(small()), tmp_path / "new", resume=True)
    assert whole(tmp_path / "new") == whole(undisturbed)


@pytest.mark.usefixtures("without_processes")
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
def test_a_damaged_part_is_put_aside_and_simulated_again(
    tmp_path: Path, harm: Callable[[Path], None], which: str, undisturbed: Path
) -> None:
    shutil.copytree(undisturbed, tmp_path, dirs_exist_ok=True)
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


@pytest.mark.usefixtures("without_processes")
def test_a_part_under_another_s_number_is_simulated_again(
    tmp_path: Path, undisturbed: Path
) -> None:
    shutil.copytree(undisturbed, tmp_path, dirs_exist_ok=True)
    before = whole(tmp_path)
    first, second = sorted(tmp_path.glob("part-*"))[:2]
    second.write_bytes(first.read_bytes())
    second.rename(tmp_path / first.name.replace("0000000", "0000001"))
    with pytest.raises(UserError, match=r"cut short or edited.*--resume"):
        read(tmp_path)
    assert sweep(study_from(small()), tmp_path, resume=True).damaged == (1,)
    assert whole(tmp_path) == before


@pytest.mark.usefixtures("without_processes")
@pytest.mark.parametrize(
    "name", ["part-0000099-{}.parquet", "part-0000000-0123456789abcdef.parquet", "x.parquet"]
)
def test_a_table_that_is_no_part_is_named_and_left_alone(
    tmp_path: Path, name: str, undisturbed: Path
) -> None:
    shutil.copytree(undisturbed, tmp_path, dirs_exist_ok=True)
    part = min(tmp_path.glob("part-*"))
    stranger = tmp_path / name.format(part.stem[-16:])
    stranger.write_bytes(part.read_bytes())
    before = whole(tmp_path)
    for go in (lambda: sweep(study_from(small()), tmp_path, resume=True), lambda: read(tmp_path)):
        with pytest.raises(UserError, match=r"holds 'part-|holds 'x"):
            go()
    assert whole(tmp_path) == before


@pytest.mark.usefixtures("without_processes")
def test_a_lost_loop_file_is_simulated_again(tmp_path: Path, undisturbed: Path) -> None:
    shutil.copytree(undisturbed, tmp_path, dirs_exist_ok=True)
    before = whole(tmp_path)
    next(iter((tmp_path / "_loops").iterdir())).unlink()
    assert len(sweep(study_from(small()), tmp_path, resume=True).damaged) == 1
    assert whole(tmp_path) == before
