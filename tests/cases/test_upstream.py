"""Patches for other projects: each adds one file of ours, which passes with the released engine."""

from __future__ import annotations

import ast
import os
import re
import subprocess
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
FOLDER = EXAMPLES / "upstream"
ADDED = {
    "mujoco": "python/mujoco/restitution_test.py",
    "newton": "newton/tests/test_restitution_phases.py",
}


def newtons_python() -> Path:
    """Python of the newest Newton that `make test-engines` has installed."""
    engines = Path(os.environ["HCBENCH_ENGINES"]) / "hcbench" / "engines"
    return sorted(engines.glob("newton@*/bin/python"))[-1]


@pytest.mark.parametrize("name", ADDED)
def test_a_patch_applies_and_adds_a_test(tmp_path: Path, name: str) -> None:
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    subprocess.run(["git", "apply", FOLDER / f"{name}.patch"], cwd=tmp_path, check=True)
    added = [path for path in tmp_path.rglob("*") if path.is_file() and ".git" not in path.parts]
    assert [path.relative_to(tmp_path).as_posix() for path in added] == [ADDED[name]]
    text = added[0].read_text("utf-8")
    assert ast.get_docstring(ast.parse(text))
    assert "Apache" in text[:800]
    assert f"{name}.patch" in (FOLDER / f"{name}.md").read_text("utf-8")


def test_a_damper_returns_a_share_of_the_speed() -> None:
    """The relation that the patch for MuJoCo tests, in the version that is installed here."""
    import mujoco

    text = (FOLDER / "mujoco.patch").read_text("utf-8")
    model = "\n".join(line[1:] for line in text.splitlines() if line.startswith("+"))
    xml = model.partition('_MODEL = """')[2].partition('"""')[0]
    for e in (0.0, 0.3, 0.8, 1.0):
        for eighth in range(8):
            h, speed, radius = 0.004, 3.0, 0.05
            height = radius + (2 + eighth / 8) * h * speed
            numbers = {"h": h, "height": height, "radius": radius, "damping": -(1 + e) / h}
            spec = mujoco.MjModel.from_xml_string(xml.format(**numbers))
            data = mujoco.MjData(spec)
            data.qvel[2] = -speed
            for _ in range(12):
                mujoco.mj_step(spec, data)
            assert data.qvel[2] / speed == pytest.approx(e, abs=3e-4)


@pytest.mark.slow
@pytest.mark.skipif("HCBENCH_ENGINES" not in os.environ, reason="by `make test-engines`")
def test_newtons_patch_passes_with_the_released_newton(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    subprocess.run(["git", "apply", FOLDER / "newton.patch"], cwd=tmp_path, check=True)
    python = newtons_python()
    test = tmp_path / ADDED["newton"]
    done = subprocess.run([python, test], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.slow
@pytest.mark.skipif("HCBENCH_ENGINES" not in os.environ, reason="by `make test-engines`")
def test_newton_1137_rebounds_as_the_page_says(tmp_path: Path) -> None:
    scene = EXAMPLES / "outside" / "newton_1137.py"
    done = subprocess.run(
        [newtons_python(), scene], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    stock, set_on = [
        sorted(float(mm) for mm in re.findall(f"{word}: (.*) mm of 90", done.stdout))
        for word in ("stock", "True}")
    ]
    page = (EXAMPLES.parent / "docs" / "reference" / "answers.md").read_text("utf-8")
    for low, high in (stock, set_on):
        assert f"{low:.0f} to {high:.0f} mm" in page.replace("\n", " ")
    assert "Newton 1.8.0" in done.stdout
