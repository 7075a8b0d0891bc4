"""A sweep's folder: nothing of another sweep gets mixed in, and a full disk loses nothing."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import socket
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fsspec
import numpy as np
import pandas as pd
import pytest
from small_sweeps import small, whole

from hcbench.benchmark import plan, store
from hcbench.benchmark.read import is_sweep, read
from hcbench.benchmark.run import sweep
from hcbench.benchmark.store import Store
from hcbench.benchmark.study import study_from
from hcbench.system.errors import CannotRun, HcbenchError, OutputError, UserError

pytestmark = pytest.mark.usefixtures("small_parts", "without_processes")


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


def test_a_field_that_only_the_folders_study_has_is_named(tmp_path: Path) -> None:
    study = study_from(small())
    sweep(replace(study, left_out="half of the phases"), tmp_path)
    with pytest.raises(UserError, match="another sweep: left_out 'half of the phases' instead"):
        sweep(study, tmp_path, resume=True)


def test_another_version_does_not_get_mixed_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
    with pytest.raises(UserError, match="schema 9; expected schema 3"):
        sweep(study_from(small()), tmp_path, resume=True)


def test_a_sweep_with_the_former_definition_of_e_is_refused_by_name(tmp_path: Path) -> None:
    (tmp_path / "_sweep.json").write_text('{"kind": "hcbench sweep", "schema": 2}')
    with pytest.raises(UserError, match="schema 2, whose e has an earlier definition"):
        sweep(study_from(small()), tmp_path, resume=True)


def test_two_sweeps_do_not_write_to_one_folder(tmp_path: Path) -> None:
    said = f"another sweep, process {os.getpid()} on .*is writing there"
    with Store(store.open_files(str(tmp_path))).locked(), pytest.raises(CannotRun, match=said):
        sweep(study_from(small()), tmp_path)
    sweep(study_from(small()), tmp_path)
    assert not (tmp_path / "_lock").exists()


def test_a_lock_file_that_its_owner_removed_locks_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The second opens the file of the first, which then ends; the third locks a new file."""
    folder, first, third = store.open_files(str(tmp_path)), ExitStack(), ExitStack()
    flock = fcntl.flock
    first.enter_context(folder.locked())

    def late(file: Any, operation: int) -> None:
        monkeypatch.setattr(fcntl, "flock", flock)
        first.close()
        third.enter_context(folder.locked())
        flock(file, operation)

    monkeypatch.setattr(fcntl, "flock", late)
    with third, pytest.raises(CannotRun, match="is writing there"), folder.locked():
        pass


def test_without_flock_one_sweep_at_a_time_writes_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows has none."""
    folder = store.open_files(str(tmp_path))
    monkeypatch.setattr(store, "sys", SimpleNamespace(platform="win32"))
    monkeypatch.delattr(fcntl, "flock")
    with folder.locked(), pytest.raises(CannotRun, match="is writing there"), folder.locked():
        pass
    assert not (tmp_path / "_lock").exists()


def test_a_folder_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for where in (tmp_path / "file" / "out", Path("/proc/out")):
        with pytest.raises(HcbenchError, match=r"^folder: "):
            sweep(study_from(small()), where)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EROFS, errno.EIO])
def test_a_full_disk_loses_nothing(
    tmp_path: Path, code: int, monkeypatch: pytest.MonkeyPatch, undisturbed: Path
) -> None:
    real, left = store.LocalFiles.write, [4]

    def write(self: store.LocalFiles, name: str, content: bytes) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(code, os.strerror(code))
        real(self, name, content)

    monkeypatch.setattr(store.LocalFiles, "write", write)
    with pytest.raises(OutputError, match=rf"{os.strerror(code)}.*--resume"):
        sweep(study_from(small()), tmp_path)
    monkeypatch.undo()
    monkeypatch.setattr(plan, "SHARD_IMPACTS", 16)
    end = sweep(study_from(small()), tmp_path, resume=True)
    assert 0 < end.resumed < 5
    assert whole(tmp_path) == whole(undisturbed)


def test_a_file_that_cannot_be_written_whole_is_not_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        store.open_files(str(tmp_path)).write("x", b"content")
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full() -> dict[str, Any]:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(store, "_myself", full)
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


def test_a_folder_can_be_anywhere_that_fsspec_opens(undisturbed: Path, tmp_path: Path) -> None:
    memory = fsspec.filesystem("memory")
    sweep(study_from(small()), "memory://bucket/sweep")
    found = {
        str(Path(path).relative_to("/bucket/sweep")): memory.cat_file(path)
        for path in memory.find("/bucket/sweep")
    }
    assert found == whole(undisturbed)
    memory.pipe_file(
        "/bucket/sweep/" + next(n for n in found if n.startswith("part-0000002")), b"cut"
    )
    end = sweep(study_from(small()), "memory://bucket/sweep", resume=True)
    assert end.damaged == (2,)
    assert memory.find("/bucket/sweep/_damaged")
    pd.testing.assert_frame_equal(read("memory://bucket/sweep").impacts, read(undisturbed).impacts)
    sweep(study_from(small()), f"file://{tmp_path}/shared")
    assert whole(tmp_path / "shared") == whole(undisturbed)
    with pytest.raises(UserError, match="nowhere://x"):
        sweep(study_from(small()), "nowhere://x")


@pytest.mark.parametrize("where", ["github://x", "jupyter://x", "dbfs://x", "no-such://x"])
def test_a_url_that_fsspec_does_not_open_is_one_line(where: str) -> None:
    with pytest.raises(UserError, match="an URL that fsspec opens"):
        store.open_files(where)


def test_a_system_that_cannot_be_reached_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(*_: object, **__: object) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr("ftplib.FTP.connect", connect)
    with pytest.raises(OutputError, match=r"ftp://no.such.host/x: Name or service not known"):
        store.open_files("ftp://no.such.host/x")


def test_there_a_lock_is_given_up_when_nobody_keeps_it_fresh() -> None:
    memory = fsspec.filesystem("memory")
    old = {"host": "far", "pid": 1, "time": time.time() - 1000, "token": "x"}
    memory.pipe_file("/locked/_lock", json.dumps({**old, "time": time.time()}).encode())
    with pytest.raises(CannotRun, match="process 1 on far"):
        sweep(study_from(small()), "memory://locked", resume=True)
    memory.pipe_file("/locked/_lock", json.dumps(old).encode())
    assert sweep(study_from(small()), "memory://locked", resume=True).shards == 5
    assert not memory.exists("/locked/_lock")


def test_a_sweep_that_slept_does_not_write_once_another_has_the_lock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    memory = fsspec.filesystem("memory")
    folder = store.open_files("memory://slept")
    with folder.locked():
        later = time.time() + 1000
        monkeypatch.setattr("time.time", lambda: later)
        folder.write("alone", b"1")
        assert json.loads(memory.cat_file("/slept/_lock"))["time"] == later
        other = {"host": "far", "pid": 1, "time": later + 999, "token": "x"}
        memory.pipe_file("/slept/_lock", json.dumps(other).encode())
        monkeypatch.setattr("time.time", lambda: later + 1000)
        with pytest.raises(CannotRun, match="process 1 on far"):
            folder.write("after", b"2")
    assert json.loads(memory.cat_file("/slept/_lock")) == other
    assert not memory.exists("/slept/after")
