"""A sweep finds what a run finds, with any number of jobs and any executor."""

from __future__ import annotations

import json
import os
import tomllib
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pytest
from long_searches import long_study
from small_sweeps import ENGINES, bouncing, small, whole

from hcbench.benchmark import plan
from hcbench.benchmark.read import read
from hcbench.benchmark.results import RUN_KEY, to_digits
from hcbench.benchmark.run import Progress, run_study, sweep
from hcbench.benchmark.study import study_from
from hcbench.sim import registry
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.usefixtures("small_parts")


@pytest.fixture(scope="module")
def engines_swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a sweep of several engines by two jobs."""
    folder = tmp_path_factory.mktemp("engines")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(plan, "SHARD_IMPACTS", 16)
        sweep(study_from(ENGINES), folder, jobs=2)
    return folder


def test_a_sweep_finds_what_a_run_finds(engines_swept: Path) -> None:
    swept, ran = read(engines_swept), run_study(study_from(ENGINES))
    for name in ("impacts", "loops", "scores"):
        pd.testing.assert_frame_equal(getattr(swept, name), getattr(ran, name))
    assert swept.settings == json.loads(json.dumps(ran.settings))
    assert swept.study == json.loads(json.dumps(ran.study))


@pytest.mark.usefixtures("without_processes")
@pytest.mark.needs_engine("pybullet")
def test_bounces_under_gravity_are_swept_too(tmp_path: Path) -> None:
    study = study_from(tomllib.loads(bouncing("reference", "mujoco", "pybullet")))
    sweep(study, tmp_path / "swept")
    swept, ran = read(tmp_path / "swept"), run_study(study)
    for name, results in (("swept.csv", swept), ("ran.csv", ran)):
        (tmp_path / name).mkdir()
        results.write(tmp_path / name)
    assert whole(tmp_path / "swept.csv") == whole(tmp_path / "ran.csv")
    assert list(swept.trains["engine"].unique()) == ["reference", "mujoco", "pybullet"]
    assert not swept.trains.duplicated([*RUN_KEY, "bounce"]).any()
    assert swept.versions == ran.versions


@pytest.mark.usefixtures("without_processes")
@pytest.mark.parametrize(
    "harm", [Path.unlink, lambda path: path.write_bytes(b"cut")], ids=["lost", "cut"]
)
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


def test_pandas_reads_the_folder(engines_swept: Path) -> None:
    table, ran = pd.read_parquet(engines_swept), read(engines_swept).impacts
    assert list(table) == list(ran)
    key = ["engine", "setting", "alpha_s_per_m", "timestep_s", "speed_m_per_s", "phase"]
    one, other = (t.astype({"engine": str, "setting": str}).sort_values(key) for t in (table, ran))
    assert np.array_equal(to_digits(one["restitution"].to_numpy()), other["restitution"])
    speeds = 4 * 12 + 2 * registry.is_there(
        "pybullet"
    )  # in four settings the kept ones too, in Bullet's two
    alphas, phases = 2, 4
    assert len(one) == alphas * speeds * phases == len(other)


def test_the_summary_has_a_line_for_each_setting(engines_swept: Path) -> None:
    summary, scores = (
        pd.read_csv(engines_swept / "_summary.csv"),
        read(engines_swept).scores,
    )
    assert len(summary) == len(scores) == 8 + 2 * registry.is_there("pybullet")
    for name in ("impacts", "parted", "rested", "failed"):
        assert summary[name].tolist() == scores[name].tolist()
    for name in ("max_error_law", "rms_error_law", "max_error_linear"):
        in_digits = to_digits(summary[name].to_numpy())
        assert in_digits == pytest.approx(scores[name].to_numpy(), rel=1e-12, abs=1e-15)


def test_numbers_of_any_size_have_ten_digits() -> None:
    sizes = np.array([1e-3, 1.0, 1e25, 1e39, 1e40, 1e55, 1e200, 1e307])
    in_digits = to_digits(1.23456789012345 * sizes)
    np.testing.assert_allclose(in_digits, 1.234567890 * sizes, rtol=1e-14)
    assert to_digits(np.array([np.inf])) == np.inf


@pytest.mark.parametrize("jobs", [1, pytest.param(3, marks=long_study)])
def test_the_number_of_jobs_does_not_change_a_byte(
    jobs: int, tmp_path: Path, engines_swept: Path
) -> None:
    sweep(study_from(ENGINES), tmp_path, jobs=jobs)
    assert whole(tmp_path) == whole(engines_swept)


def test_any_executor_does(tmp_path: Path, undisturbed: Path) -> None:
    study = study_from(small())
    with ThreadPoolExecutor(2) as threads:
        sweep(study, tmp_path / "threads", executor=threads)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        sweep(study, tmp_path / "processes", executor=processes)
        assert processes.submit(os.getpid).result() != os.getpid(), "it is left open"
    for name in ("threads", "processes"):
        assert whole(tmp_path / name) == whole(undisturbed)


@pytest.mark.usefixtures("without_processes")
def test_what_a_study_asks_wrongly_is_said_before_anything_is_made(tmp_path: Path) -> None:
    wrong = {**ENGINES, "run": [{"engine": "mujoco", "recipe": "nothing", "timesteps": 1e-6}]}
    with pytest.raises(UserError, match="nothing"):
        sweep(study_from(wrong), tmp_path / "out")
    assert not (tmp_path / "out" / "_sweep.json").exists()


@pytest.mark.usefixtures("without_processes")
def test_progress_counts_up_to_all_impacts(tmp_path: Path) -> None:
    seen: list[Progress] = []
    end = sweep(study_from(small()), tmp_path, progress=seen.append)
    assert [p.impacts for p in seen] == sorted(p.impacts for p in seen)
    assert (seen[0].impacts, seen[-1].impacts, end.of) == (0, 80, 80)
    assert end == seen[-1]


@pytest.mark.usefixtures("without_processes")
def test_the_summary_can_be_opened_while_it_runs(tmp_path: Path) -> None:
    seen = []

    def look(now: Progress) -> None:
        summary = pd.read_csv(tmp_path / "_summary.csv")
        seen.append(int(summary["impacts"].sum()))
        assert 0 < len(pd.read_parquet(tmp_path)) == now.impacts or now.impacts == 0

    sweep(study_from(small()), tmp_path, progress=look)
    assert seen[0] == 0
    assert pd.read_csv(tmp_path / "_summary.csv")["impacts"].sum() == 80
