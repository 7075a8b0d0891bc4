"""The page's errors of e at the steps of robots and of reinforcement learning are what is measured."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import pytest

from hcbench.cli import run

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "engines.md"
STEPS = 'timesteps = "1e-3, 2e-3, 5e-3 s"\ngravity = "9.81 m/s^2"'
STUDY = """scene = "steel-plane"
alphas = "0.3 s/m"
speeds = "0.1, 0.2, 0.5, 1, 2 m/s"
phases = 4
"""
# The page gives the digits of larger errors, and bounds of smaller ones.
SMALL = 1e-3


def printed() -> dict[str, list[float]]:
    """The largest error of e at each of the steps, by setting."""
    _, _, rest = PAGE.read_text("utf-8").partition("<!-- measured: steps of robots -->\n")
    table = rest.partition("\n\n")[0]
    rows = re.findall(r"^\| `(.+?)` \| (.+) \|$", table, re.M)
    return {name: [float(cell) for cell in cells.split(" | ")] for name, cells in rows}


@pytest.mark.needs_engine
@pytest.mark.parametrize("engine", ["mujoco", "mjx", "mujoco-warp", "newton"])
def test_errors_at_the_steps_of_robots_are_those_of_the_page(engine: str, tmp_path: Path) -> None:
    page = {name: row for name, row in printed().items() if name.partition(".")[0] == engine}
    assert page
    study = tmp_path / "study.toml"
    study.write_text(STUDY, encoding="utf-8")
    with study.open("a", encoding="utf-8") as file:
        for name in page:
            recipe = name.partition(".")[2]
            file.write(f'[[run]]\nengine = "{engine}"\nrecipe = "{recipe}"\n{STEPS}\n')
    assert run(["sweep", str(study), "--out", str(tmp_path / "sweep")]) == 0
    measured: dict[str, list[float]] = {}
    with (tmp_path / "sweep" / "_summary.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file):
            errors = measured.setdefault(f"{row['engine']}.{row['setting']}", [])
            errors.append(float(row["max_error_law"]))
    assert measured.keys() == page.keys()
    for name, errors in page.items():
        for error, shown in zip(measured[name], errors, strict=True):
            if shown < SMALL:
                assert error <= shown
            else:
                assert error == pytest.approx(shown, rel=0.06)
