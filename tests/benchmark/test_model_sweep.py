"""Sweeps of a user's model: rows of contact parameters, measured as `measure` does, and written in
parts that nothing loses.
"""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pandas as pd
import pytest
from dask_processes import WORKER, kill, running, scheduler
from in_place import in_place
from long_searches import long_study
from small_sweeps import until, whole

import hcbench as hb
from hcbench.benchmark import model_sweep, store
from hcbench.benchmark.model_sweep import ModelSweep, sweep_model
from hcbench.benchmark.shard import Timeouts
from hcbench.benchmark.vary import read_parameters, rows_of
from hcbench.cli import run as cli
from hcbench.measuring.curve import impacts_of
from hcbench.measuring.request import make_request
from hcbench.sim import registry
from hcbench.system.errors import CannotRun, OutputError, UserError

# The second ball keeps the plate's parameters from being the pair's alone.
BALL = """<mujoco><option timestep="0.0005" gravity="0 0 0" cone="elliptic" impratio="10"/><worldbody>
<geom name="plate" type="plane" size="5 5 .1" {plate}/>
<body name="ball" pos="0 0 .1"><freejoint/><geom name="ball" size=".05" mass=".2" {ball}/></body>
<body name="other" pos="1 0 .1"><freejoint/><geom name="other" size=".05" mass=".2"/></body>
</worldbody></mujoco>"""
STIFF = 'solref="-4000 -20"'
# A user's function, which is called in the worker: there a launch of one row kills the process.
DIES = """
def make():
    import os, mujoco
    from hcbench.benchmark import model_sweep
    real = model_sweep.impacts_of
    def dying(opened, request):
        if opened.model.pair_solref[0, 0] == -3000:
            os.kill(os.getpid(), 11)
        return real(opened, request)
    model_sweep.impacts_of = dying
    return mujoco.MjSpec.from_string('''{text}''')
"""
# A world of PyBullet, whose numbers are those of its arguments, or Bullet's defaults.
WORLD = """
def make(restitution=None, friction=None):
    import pybullet as p
    from hcbench.engines.pybullet.model.open import LiveWorld
    at = {{"physicsClientId": p.connect(p.DIRECT)}}
    p.setGravity(0, 0, 0, **at)
    p.setTimeStep(1e-3, **at)
    none = dict(restitutionVelocityThreshold=0, contactSlop=0, contactERP=0)
    p.setPhysicsEngineParameter(**none, **at)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[5, 5, .5], **at)
    plate = p.createMultiBody(0, box, basePosition=[0, 0, -.5], **at)
    sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=.05, **at)
    ball = p.createMultiBody(1, sphere, basePosition=[0, 0, .1], **at)
    for body in (ball, plate):
        p.changeDynamics(body, -1, contactProcessingThreshold=0, **at)
    if restitution is not None:
        p.changeDynamics(ball, -1, restitution=restitution, lateralFriction=2 * friction, **at)
        p.changeDynamics(plate, -1, restitution=1, lateralFriction=.5, **at)
    return LiveWorld(at["physicsClientId"], ball, plate)
def direct():
    return make({numbers})
"""
VARY = ["friction=0.2, 0.9", "solref.0=-9000:-1000:5"]
ROWS = 10


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("model") / "ball.xml"
    path.write_text(BALL.format(plate=STIFF, ball=STIFF))
    return path


def swept(model: Path, folder: Path, **more: Any) -> ModelSweep:
    """A sweep of ten rows in five parts."""
    options: dict[str, Any] = {"part_rows": 2, "speeds": "1 m/s", "phases": 1, **more}
    return sweep_model(model, "ball,plate", options.pop("vary", VARY), folder, **options)


@pytest.fixture(scope="module")
def undisturbed(model: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    with in_place():
        assert swept(model, folder).parts == 5
    return folder


# What is measured.


@pytest.mark.parametrize(("friction", "stiffness"), [(0.2, 1000.0), (0.9, 9000.0)])
def test_a_row_is_what_measure_prints_of_a_model_with_its_numbers_in_the_xml(
    model: Path, tmp_path: Path, friction: float, stiffness: float
) -> None:
    launch: dict[str, Any] = {"speeds": "0.5, 1 m/s", "angle": "0, 45 deg"}
    vary = [f"friction={friction}", f"solref.0={-stiffness}"]
    with in_place():
        sweep_model(model, "ball,plate", vary, tmp_path, **launch)
    table = pd.read_parquet(tmp_path)
    numbers = f'friction="{friction} .005 .0001" solref="{-stiffness} -20"'
    text = BALL.format(plate=numbers, ball=numbers)
    measured = hb.measure(text, "ball,plate", diagnose=False, rest=False, **launch)
    expected = pd.DataFrame([point.record(True) for point in measured.curve])
    shared = [name for name in table if name in expected]
    assert {"restitution", "samples", "impulse_ratio", "slip_out_m_per_s"} <= set(shared)
    pd.testing.assert_frame_equal(table[shared], expected[shared], check_exact=True)
    lowest, highest, ratio = in_own_steps(text)
    at_45 = table.iloc[3]
    assert lowest - 1e-4 < table["restitution"].iloc[2] < highest + 1e-4
    assert at_45["impulse_ratio"] == pytest.approx(ratio, abs=2e-3)
    # It slides all the time under the one friction, and comes to roll under the other.
    assert (ratio == pytest.approx(friction, abs=0.01)) == (friction == 0.2)


def in_own_steps(text: str) -> tuple[float, float, float]:
    """Lowest and highest e of a ball at 1 m/s over the places in a step where it touches, and the
    tangential impulse over the normal one at 45 degrees.
    """
    own = mujoco.MjModel.from_xml_string(text)
    e, ratio = [], 0.0
    for share in np.arange(32) / 32:
        for slip in (0.0, 1.0) if share == 0 else (0.0,):
            data = mujoco.MjData(own)
            data.qpos[2] = 0.05 + own.opt.timestep * (2.0 + share)
            data.qvel[[0, 2]] = slip, -1.0
            touched = False
            while not touched or data.ncon:
                mujoco.mj_step(own, data)
                touched |= bool(data.ncon)
            out = data.qvel[2]
            if slip:
                ratio = (slip - data.qvel[0]) / (1.0 + out)
            else:
                e.append(out)
    return min(e), max(e), ratio


@pytest.mark.skipif(not registry.is_there("pybullet"), reason="PyBullet is not installed")
def test_in_pybullet_too_a_row_is_what_measure_prints(tmp_path: Path) -> None:
    script = tmp_path / "world.py"
    script.write_text(WORLD.format(numbers="0.8, 0.1"))
    launch: dict[str, Any] = {"speeds": "1 m/s", "angle": "0, 45 deg", "engine": "pybullet"}
    vary = ["restitution=0.3, 0.8", "friction=0.1"]
    sweep_model(f"{script}:make", None, vary, tmp_path / "out", **launch)
    table = pd.read_parquet(tmp_path / "out")
    found = hb.measure(f"{script}:direct", diagnose=False, rest=False, **launch)
    expected = pd.DataFrame([point.record(True) for point in found.curve])
    swept_there = table[table["restitution_set"] == 0.8].reset_index(drop=True)
    shared = [name for name in table if name in expected]
    pd.testing.assert_frame_equal(swept_there[shared], expected[shared], check_exact=True)
    np.testing.assert_allclose(table["restitution"], [0.3, 0.3, 0.8, 0.8], atol=2e-3)
    np.testing.assert_allclose(table["impulse_ratio"], [0.0, 0.1, 0.0, 0.1], atol=1e-6)


def test_only_the_pair_is_varied(model: Path) -> None:
    request = make_request("other,plate")
    engine: Any = registry.engine("mujoco")
    (before, after) = (
        engine.open(model, request),
        engine.varied(model, make_request("ball,plate")).open(request, {"friction": 0.1}),
    )
    assert before.place.contact.rows == after.place.contact.rows
    assert before.facts().friction == after.facts().friction == 1.0


def test_a_varied_step_is_that_of_timestep(model: Path, tmp_path: Path) -> None:
    with in_place():
        swept(model, tmp_path, vary=["timestep=1, 4 ms"])
    rows = pd.read_parquet(tmp_path)
    for step, e in zip(rows["timestep_s"], rows["restitution"], strict=True):
        one = hb.measure(
            model, "ball,plate", timestep=step, speeds=1, phases=1, diagnose=False, rest=False
        )
        assert one.curve[0].restitution == e


def test_at_rest_a_row_is_what_measure_prints(model: Path, tmp_path: Path) -> None:
    launch: dict[str, Any] = {"speeds": 1, "phases": 1, "gravity": 9.81}
    with in_place():
        swept(model, tmp_path, vary=["solref.0=-9000, -1000"], rest=True, **launch)
    rows = pd.read_parquet(tmp_path)
    soft = 'solref="-1000 -20"'
    text = BALL.format(plate=soft, ball=soft)
    lies = hb.measure(text, "ball,plate", diagnose=False, **launch).rest
    assert lies is not None
    assert rows["rest_penetration_m"][1] == lies.penetration
    assert rows["rest_vibration_m_per_s"][1] == lies.vibration
    # It lies about g/k deep, and k is nine times as large.
    assert rows["rest_penetration_m"][0] < rows["rest_penetration_m"][1] / 5


def test_a_row_that_is_refused_or_fails_has_the_reason(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(opened: Any, request: Any) -> Any:
        if opened.model.pair_solref[0, 0] == -2000:
            raise RuntimeError("the solver lost its way")
        return impacts_of(opened, request)

    monkeypatch.setattr(model_sweep, "impacts_of", failing)
    with in_place():
        end = swept(model, tmp_path, vary=["solref.0=-4000, 4000, -2000"])
    rows = pd.read_parquet(tmp_path)
    assert rows["status"].tolist() == ["measured", "refused", "crashed"]
    assert "4000 -20 of plate and ball" in rows["reason"][1]
    assert rows["reason"][2] == "RuntimeError: the solver lost its way"
    assert rows["restitution"].isna().tolist() == [False, True, True]
    assert (end.points, end.without_e) == (3, 2)


def test_an_engine_that_dies_costs_its_row(tmp_path: Path) -> None:
    script = tmp_path / "dies.py"
    script.write_text(DIES.format(text=BALL.format(plate=STIFF, ball=STIFF)))
    words = ["sweep", f"{script}:make", "--pair", "ball,plate", "--speeds", "1", "--phases", "1"]
    words += ["--vary", "solref.0=-4000, -3000, -2000", "--jobs", "1", "--out", "out"]
    # In processes of its own, since the function that dies lasts as long as the worker.
    subprocess.run([sys.executable, "-m", "hcbench", *words], cwd=tmp_path, check=True)
    rows = pd.read_parquet(tmp_path / "out")
    assert rows["status"].tolist() == ["measured", "crashed", "measured"]
    assert rows["reason"][1] == "crashed with SIGSEGV"


# Rows.


def test_a_grid_has_every_row_and_a_draw_has_each_once() -> None:
    grid = read_parameters(["a=1, 2, 3", "b=-100:-1:3 log"])
    every = rows_of(grid, None, 0)
    b = [-100.0, -10.0, -1.0]
    np.testing.assert_allclose(every, [[a, each] for a in (1.0, 2.0, 3.0) for each in b])
    assert (rows_of(grid, 9999, 0) == every).all()
    some = rows_of(grid, 5, 1)
    assert len({tuple(row) for row in some}) == 5
    assert {tuple(row) for row in some} < {tuple(row) for row in every}
    assert (some != rows_of(grid, 5, 2)).any()


def test_a_grid_that_is_too_large_to_number_is_refused_with_the_way_to_draw() -> None:
    grid = read_parameters([f"{name}=1:1000:1000" for name in "abcdefg"])
    with pytest.raises(UserError, match=r"vary: a grid of 1e\+21 rows; .*NAME=LOW:HIGH"):
        rows_of(grid, 5, 0)
    assert rows_of(grid[:6], 5, 0).shape == (5, 6)


def test_a_draw_of_bands_is_even_and_begins_with_a_shorter_one() -> None:
    bands = read_parameters(["a=0.3:1", "b=-1e5:-1e3 log", "c=1, 2"])
    rows = rows_of(bands, 4000, 7)
    assert (rows_of(bands, 100, 7) == rows[:100]).all()
    shares = (rows[:, 0] - 0.3) / 0.7, (np.log10(-rows[:, 1]) - 3.0) / 2.0, rows[:, 2] - 1.0
    for share in shares:
        assert 0.0 <= share.min() < share.max() <= 1.0
        assert share.mean() == pytest.approx(0.5, abs=0.02)
        assert share[share > 0.5].mean() - share[share < 0.5].mean() >= 0.47


# Files.


def test_two_jobs_write_the_bytes_of_one(model: Path, tmp_path: Path, undisturbed: Path) -> None:
    swept(model, tmp_path, jobs=2)
    assert whole(tmp_path) == whole(undisturbed)


def test_shards_together_are_the_whole(model: Path, tmp_path: Path, undisturbed: Path) -> None:
    with in_place():
        ends = [swept(model, tmp_path, shard=f"{i}/3") for i in (3, 1, 2)]
        assert [end.parts for end in ends] == [1, 2, 2]
        assert sum(end.rows for end in ends) == ROWS
    assert whole(tmp_path) == whole(undisturbed)


def test_killed_it_goes_on_where_it_was(model: Path, tmp_path: Path, undisturbed: Path) -> None:
    words = ["sweep", str(model), "--pair", "ball,plate", "--speeds", "1", "--phases", "1"]
    words += ["--part-rows", "2", "--jobs", "1", "--out", str(tmp_path)]
    words += [word for each in VARY for word in ("--vary", each)]
    with subprocess.Popen([sys.executable, "-m", "hcbench", *words]) as process:
        until(lambda: bool(list(tmp_path.glob("part-*"))), process)
        process.send_signal(signal.SIGKILL)
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.glob("part-*")}
    assert 1 <= len(before) < 5
    with in_place():
        assert cli([*words, "--resume"]) == 0
    assert {name: (tmp_path / name).stat().st_mtime_ns for name in before} == before
    visible = {name: text for name, text in whole(tmp_path).items() if not name.startswith(".")}
    assert visible == whole(undisturbed)


def test_a_part_that_was_cut_short_is_measured_again(
    model: Path, tmp_path: Path, undisturbed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, content in whole(undisturbed).items():
        (tmp_path / name).write_bytes(content)
    cut = min(tmp_path.glob("part-*"))
    cut.write_bytes(cut.read_bytes()[:-9])
    with in_place():
        end = swept(model, tmp_path)
    assert (end.damaged, end.there, end.parts) == ((cut.name,), 4, 1)
    assert whole(tmp_path) == whole(undisturbed)


def test_a_full_disk_is_one_line_and_loses_nothing(
    model: Path, tmp_path: Path, undisturbed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, left = store.LocalFiles.write, [3]

    def write(self: Any, name: str, content: bytes) -> None:
        left[0] -= 1
        if left[0] < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        real(self, name, content)

    with in_place():
        with monkeypatch.context() as full:
            full.setattr(store.LocalFiles, "write", write)
            with pytest.raises(OutputError, match=r"No space left on device.*--resume"):
                swept(model, tmp_path)
        assert swept(model, tmp_path).there == 2
    assert whole(tmp_path) == whole(undisturbed)


@long_study  # tests/benchmark/test_sweep_cluster.py loses one in a sweep of engines
def test_a_lost_worker_leaves_the_same_bytes(
    model: Path, tmp_path: Path, undisturbed: Path
) -> None:
    with (
        running(scheduler()) as (_, address),
        running(WORKER.format(path=[], address=address)) as (worker, _),
    ):

        def lose(now: ModelSweep) -> None:
            if now.parts == 1:
                kill(worker)

        end = swept(model, tmp_path, scheduler=address, progress=lose)
    assert (end.parts, worker.returncode) == (5, -signal.SIGKILL)
    assert whole(tmp_path) == whole(undisturbed)


def test_a_worker_with_another_model_is_one_line(model: Path, tmp_path: Path) -> None:
    job = model_sweep._SweepJob(
        source=str(model),
        engine="mujoco",
        request=make_request("ball,plate"),
        wanted=None,
        tolerance=0.0,
        diagnose=False,
        files="0123456789abcdef",
    )
    part = model_sweep.SweepPart(job, 0, np.ones((1, 1)), "part")
    with in_place():
        with pytest.raises(CannotRun, match=r"ball\.xml is not there, or not the same"):
            model_sweep.measure_part(part, Timeouts())
        other = replace(part, job=replace(job, versions=(("mujoco", "2.0"),)))
        with pytest.raises(CannotRun, match=r"has mujoco .*; expected mujoco 2\.0"):
            model_sweep.measure_part(other, Timeouts())


def test_another_sweep_does_not_get_mixed_in(
    model: Path, tmp_path: Path, undisturbed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = whole(undisturbed)
    other = tmp_path / "ball.xml"
    other.write_text(BALL.format(plate=STIFF, ball=""))
    with in_place():
        changes: list[tuple[Path, dict[str, Any], str]] = [
            (model, {"vary": ["friction=0.2"]}, "parameters"),
            (model, {"speeds": "2 m/s"}, r"launches: speeds \[.*\] instead of \[2\.0\]"),
            (model, {"gravity": 3.7}, "launches: gravity None instead of"),
            (model, {"part_rows": 3}, "rows in a part"),
            (other, {}, "files"),
        ]
        for source, changed, what in changes:
            with pytest.raises(UserError, match=f"holds another sweep: {what}"):
                swept(source, undisturbed, **changed)
        assert cli(["report", str(undisturbed), "--out", str(tmp_path / "page")]) == 2
        assert "holds a sweep of a model" in capsys.readouterr().err
        (tmp_path / "mine.parquet").write_bytes(b"")
        with pytest.raises(UserError, match="no part of this sweep"):
            swept(model, tmp_path)
    assert whole(undisturbed) == before


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--vary", "friction"], "--vary: 'friction'; expected NAME=VALUES"),
        (["--vary", "mass=1"], "--vary: mass; expected one of: friction"),
        (["--vary", "friction=0.1:1"], "--vary: friction from LOW to HIGH; expected how many"),
        (["--vary", "friction=-1:1:3 log"], "expected a range on one side of 0"),
        (["--vary", "friction=1", "--vary", "friction=2"], "expected each parameter once"),
        (["--vary", "friction=1", "--shard", "4/3"], "--shard: '4/3'; expected NUMBER/OF"),
        (["--vary", "friction=1", "--device", "cpu"], "--device: given with a model"),
        (["--vary", "friction=1", "--engine", "drake"], "expected one that varies contacts"),
        (["--samples", "3"], "--samples: given without --vary"),
        ([], "is a model; expected --vary"),
    ],
)
def test_a_mistake_is_one_line(
    model: Path, tmp_path: Path, words: list[str], line: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["sweep", str(model), "--out", str(tmp_path / "out"), *words]
    if "--vary" in words:
        command += ["--pair", "ball,plate"]
    with in_place():
        assert cli(command) == 2
    error = capsys.readouterr().err
    assert line in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()
