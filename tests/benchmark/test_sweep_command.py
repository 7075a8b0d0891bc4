"""The command sweeps, resumes and reports."""

from __future__ import annotations

from pathlib import Path

import pytest
from small_sweeps import bouncing, whole

from hcbench.cli import run as cli

pytestmark = pytest.mark.usefixtures("small_parts", "without_processes")


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
    assert cli(["sweep", "bouncing.toml", "--out", "bounced", "--jobs", "1"]) == 0
    min(Path("bounced").glob("part-*")).write_bytes(b"")
    capsys.readouterr()
    assert cli(["sweep", "bouncing.toml", "--out", "bounced", "--jobs", "1", "--resume"]) == 0
    assert "part 0 was cut short or edited" in capsys.readouterr().err
    assert cli(["report", "bounced", "--out", "of-a-sweep"]) == 0
    assert "Restitution" in Path("of-a-sweep/index.html").read_text(encoding="utf-8")
    assert cli(["report", "bouncing.toml", "--out", "of-a-run", "--jobs", "1"]) == 0
    assert whole(Path("of-a-sweep")) == whole(Path("of-a-run"))
    assert cli(["sweep", "nowhere.toml"]) == 2
    capsys.readouterr()
    assert cli(["sweep", "study.toml", "--jobs", "1"]) == 0
    assert cli(["report", "study.toml", "--quick", "--jobs", "1"]) == 0
    assert capsys.readouterr().out.split() == ["sweeps/balls", "reports/balls-quick/index.html"]
