"""A study is checked setting by setting."""

from __future__ import annotations

from pathlib import Path

import pytest

from hcbench.checking import CheckSpec, Verdict, check
from hcbench.cli import run
from hcbench.system.errors import UserError

STUDY = """schema = 1
scene = "steel-plane"
alphas = "0.008 s/in"
speeds = "8, 16 in/s"
phases = 2
[[run]]
engine = "reference"
recipe = "hunt-crossley"
timesteps = "1e-5 s"
[[run]]
engine = "reference"
recipe = "kelvin-voigt"
timesteps = "1e-5 s"
"""


def test_a_study_is_checked_setting_by_setting(tmp_path: Path) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    report = check(CheckSpec(model=str(tmp_path / "study.toml"), max_error=1e-6))
    law, voigt = report.outcomes
    assert law.verdict is Verdict.PASSED
    assert voigt.verdict is Verdict.FAILED
    with pytest.raises(UserError, match="differs from the study"):
        check(CheckSpec(model=str(tmp_path / "study.toml"), restitution=0.9))


@pytest.mark.parametrize(
    ("option", "value"),
    [
        *(
            ("limit", "-5"),
            ("limit", "5"),
            ("speeds", "0.1"),
            ("phases", "2"),
            ("timestep", "1e-3"),
        ),
        *(
            ("gravity", "0"),
            ("height", "1"),
            ("engine", "mujoco"),
            ("max-error", "7"),
            ("max-error", "-1"),
        ),
    ],
)
def test_a_study_refuses_what_it_would_ignore(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str, value: str
) -> None:
    (tmp_path / "study.toml").write_text(STUDY)
    assert run(["check", str(tmp_path / "study.toml"), f"--{option}", value]) == 2
    assert capsys.readouterr().err.startswith(f"hcbench: --{option}: ")
