"""Public docstrings: the example of each runs and prints what it shows; NumPy's sections are there."""

from __future__ import annotations

import doctest
import importlib
import inspect
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hcbench

pytestmark = pytest.mark.usefixtures("tuned_once")

ROOT = Path(__file__).parents[2]
VERBS = ["check", "convert", "fit", "law", "measure", "pairs", "report", "tune", "tune_model"]
STUDY = """scene = "steel-plane"
alphas = "0.3 s/m"
speeds = "0.2 m/s"
phases = 2
[[run]]
engine = "mujoco"
recipe = "impulse"
timesteps = 1e-3
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The files that the examples name."""
    shutil.copy(ROOT / "examples" / "good.xml", tmp_path / "ball.xml")
    (tmp_path / "study.toml").write_text(STUDY, encoding="utf-8")
    speeds = np.linspace(0.1, 1.0, 12)
    e = hcbench.law(0.3).e(speeds) * (1 + 1e-3 * np.cos(7.0 * np.arange(12)))
    rows = "".join(f"{v:.6f},{each:.6f}\n" for v, each in zip(speeds, e, strict=True))
    (tmp_path / "pairs.csv").write_text(f"speed [m/s],restitution\n{rows}", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", [*VERBS, "ImpactLaw.e", "__doc__"])
def test_the_example_of_a_public_name_prints_what_it_shows(name: str, folder: Path) -> None:
    found: Any = hcbench
    for part in name.split("."):
        found = getattr(found, part)
    text = found if isinstance(found, str) else found.__doc__
    test = doctest.DocTestParser().get_doctest(text or "", {}, name, None, 0)
    assert test.examples
    lines: list[str] = []
    failed, _ = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(
        test, out=lines.append
    )
    assert not failed, "".join(lines)


@pytest.mark.parametrize("name", VERBS)
def test_a_verb_says_what_it_takes_returns_and_raises(name: str) -> None:
    text = inspect.getdoc(getattr(hcbench, name)) or ""
    for section in ("Parameters", "Returns", "Raises", "Examples"):
        assert f"{section}\n{'-' * len(section)}\n" in text
    command = name.partition("_")[0]
    assert f"`hcbench {command}" in text
    assert command in importlib.import_module("hcbench.cli").app.commands


RESULTS: dict[str, Callable[[], Any]] = {
    "law": lambda: hcbench.law("0.3 s/m"),
    "pairs": lambda: hcbench.pairs("ball.xml"),
    "measure": lambda: hcbench.measure("ball.xml", "ball,plate", speeds="0.1:1:9 m/s", phases=1),
    "check": lambda: hcbench.check("ball.xml", "ball,plate", restitution=0.9, speeds=0.3, phases=1),
    "tune": lambda: hcbench.tune("mujoco", alpha="0.3 s/m", timestep="2 ms", kind="exact"),
    "fit": lambda: hcbench.fit("pairs.csv"),
    "convert": lambda: hcbench.convert(alpha="0.3 s/m", speed="1 m/s"),
}


@pytest.mark.parametrize("name", RESULTS)
def test_a_result_shows_itself_in_twelve_lines_and_as_a_table(name: str, folder: Path) -> None:
    result = RESULTS[name]()
    lines = repr(result).splitlines()
    assert 1 <= len(lines) <= 12 and max(map(len, lines)) <= 100
    assert not any(
        "object at 0x" in line or line.startswith(f"{type(result).__name__}(") for line in lines
    )
    frame = result.to_frame()
    assert len(frame) and len(frame.columns) > 1
    assert "<t" in result._repr_html_()
    if name in ("law", "measure", "tune", "fit"):
        assert result.plot().axes


@pytest.mark.parametrize("speed", ["1 m/s", "100 cm/s", 1.0, np.float64(1.0)])
def test_a_speed_is_text_a_number_or_pints(speed: Any) -> None:
    registry = pytest.importorskip("pint").UnitRegistry()
    law = hcbench.law(alpha=0.3 * registry("s/m"))
    assert law.e(speed) == law.e(100.0 * registry("cm/s")) == pytest.approx(0.768, abs=5e-5)
    several = np.array([[0.5, 1.0], [1.5, 2.0]])
    assert law.e(several * registry("m/s")).shape == law.e(several).shape == (2, 2)
