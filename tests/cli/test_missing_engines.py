"""A missing engine: a gap in a built-in study's page, and an error where a user named it."""

from __future__ import annotations

from pathlib import Path

import pytest

from hcbench import cli
from hcbench.benchmark.plan import versions_here
from hcbench.benchmark.study import find_study, is_built_in, load_study
from hcbench.benchmark.tables import arrays, frame, metadata_in, parquet
from hcbench.reporting.ask import engines_in, find_plan, folder_for
from hcbench.sim import install, registry, simulate
from hcbench.sim.backend import Backend
from hcbench.system.errors import EngineMissing, UserError

ADD = "hcbench engines add pybullet --python 3.11"


@pytest.fixture
def without_bullet(monkeypatch: pytest.MonkeyPatch) -> None:
    real = Backend.version

    def version(self: Backend) -> str:
        if self.engine == "pybullet":
            raise self._missing("not installed", "its wheel")
        return real(self)

    monkeypatch.setattr(Backend, "version", version)
    simulate.require_installed.cache_clear()  # an earlier test may have run it in this process
    versions_here.cache_clear()


def test_a_built_in_study_leaves_it_out_and_says_how_to_add_it(
    without_bullet: None, capsys: pytest.CaptureFixture[str]
) -> None:
    name, study = find_plan("steel-1lb", print)
    assert name == "steel-1lb"
    assert study.missing == ("pybullet",)
    assert {run.engine for run in study.runs} == {"mujoco", "reference"}
    assert study.described()["missing"] == ["pybullet"]
    assert capsys.readouterr().out == f"left out, not installed: pybullet. Add: {ADD}\n"


@pytest.mark.needs_engine("pybullet")
def test_nothing_is_left_out_where_all_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    study = find_plan("steel-1lb", print)[1]
    assert "missing" not in study.described()
    assert not capsys.readouterr().out


def test_a_study_of_the_users_own_needs_what_it_names(
    without_bullet: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "study.toml"
    run = '[[run]]\nengine = "pybullet"\nrecipe = "restitution"\ntimesteps = 1e-3\n'
    file.write_text(f'scene = "steel-plane"\nalphas = 0.3\nspeeds = 0.2\n{run}', encoding="utf-8")
    assert not is_built_in(file)
    assert is_built_in(find_study("steel-1lb"))
    assert find_plan(str(file), print)[1] == load_study(file)
    assert cli.run(["report", str(file), "--out", str(tmp_path / "out"), "-j", "1"]) == 3
    assert ADD in capsys.readouterr().err
    assert cli.run(["tune", "pybullet", "--restitution=0.9", "--timestep=1e-3"]) == 3
    assert ADD in capsys.readouterr().err


def test_a_page_with_a_gap_never_replaces_one_without(tmp_path: Path) -> None:
    full = tmp_path / "reports"
    full.mkdir()
    (full / "scores.csv").write_text(
        "engine,setting\nmujoco,impulse\npybullet,stock\n", encoding="utf-8"
    )
    there = engines_in(full)
    assert there == {"mujoco", "pybullet"}
    with pytest.raises(UserError, match="holds a report with pybullet"):
        folder_for(full, full, ("pybullet",), there)
    assert folder_for(None, full, ("pybullet",), there).name == "reports-without-pybullet"
    assert folder_for(full, full, (), there) == full
    assert engines_in(tmp_path) == set()


def test_commands_that_add_engines_say_the_python_that_one_needs() -> None:
    assert install.add_commands(["dart", "pybullet", "drake"]) == [
        "hcbench engines add dart drake",
        ADD,
    ]
    with pytest.raises(EngineMissing, match=r"engines add pybullet@3\.2\.1 --python 3\.11"):
        registry.engine("pybullet@3.2.1").version()


def test_both_encodings_of_a_table_read_back_the_same() -> None:
    pytest.importorskip("pyarrow")
    tables = [
        {
            "engine": "a",
            "alpha_s_per_m": 0.3,
            "status": ["parted", "rested"],
            "samples": [3, 4],
            "x": [0.1, 1e-300],
        },
        {
            "engine": "b",
            "alpha_s_per_m": 0.4,
            "status": ["parted"],
            "samples": [5],
            "x": [float("nan")],
        },
    ]
    encoded = [encode(tables, list(tables[0]), {"about": b"1"}) for encode in (arrays, parquet)]
    one, two = (frame([content, content]) for content in encoded)
    assert one.equals(two)
    assert one.dtypes.tolist() == two.dtypes.tolist()
    assert [metadata_in(content)["about"] for content in encoded] == [b"1", b"1"]


def test_engines_without_a_module_have_none() -> None:
    assert registry.submodule("dart", "two_blocks") is None
    assert registry.submodule("mujoco", "two_blocks") is not None
