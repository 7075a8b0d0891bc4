"""Promises of `tune pybullet` stay with the body, and `measure` reads them again."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import pytest

import hcbench as hb
from hcbench.sim.promise import Promise

WORLD = """import pybullet
from hcbench.contact import pybullet as contact


def build():
    pybullet.connect(pybullet.DIRECT)
    pybullet.setGravity(0, 0, -9.81)
    sphere = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=0.05)
    plate = pybullet.createMultiBody(0, pybullet.createCollisionShape(pybullet.GEOM_PLANE))
    ball = pybullet.createMultiBody(0.45, sphere, basePosition=[0, 0, 1])
{text}
{after}
"""


@cache
def text() -> str:
    asked: dict[str, Any] = {"timestep": "1 ms", "speeds": "0.1:0.5 m/s", "kind": "exact"}
    return hb.tune("pybullet", alpha=0.3, **asked).text


def measured(folder: Path, after: str) -> Any:
    pasted = text().replace(
        "import pybullet\nfrom hcbench.contact import pybullet as contact\n", ""
    )
    lines = "\n".join(f"    {line}" for line in pasted.splitlines())
    world = folder / "world.py"
    world.write_text(WORLD.format(text=lines, after=f"    {after}"))
    return hb.measure(f"{world}:build", ("body:1", "body:0"), speeds="0.1:0.5:2 m/s", rest=False)


def test_a_world_with_the_pasted_text_keeps_its_promise(tmp_path: Path) -> None:
    found = measured(tmp_path, "")
    promise = found.facts.promise
    assert isinstance(promise, Promise)
    assert promise.speeds == (0.1, 0.5)
    assert promise.is_kept(found.impacts)
    assert not found.causes
    assert "The plug-in by hcbench for α = 0.3 s/m" in found.facts.notes[0]


@pytest.mark.parametrize(
    ("after", "code"),
    [
        ("pybullet.setTimeStep(4e-3)", "promised-timestep"),
        (
            "pybullet.executePluginCommand(plugin, 'remove', [0])",
            "promised-plugin",
        ),
        ("pybullet.setPhysicsEngineParameter(numSubSteps=4)", "promised-substeps"),
    ],
)
def test_what_broke_a_promise_is_named(after: str, code: str, tmp_path: Path) -> None:
    found = measured(tmp_path, after)
    assert code in found.facts.changed
    assert code in [cause.code for cause in found.causes]


def test_a_shorter_step_breaks_no_promise_of_the_plugin(tmp_path: Path) -> None:
    found = measured(tmp_path, "pybullet.setTimeStep(2e-4)")
    assert found.facts.changed == ()
    assert found.facts.promise.is_kept(found.impacts)
