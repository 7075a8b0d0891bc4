"""No command shows Python's own form of an object."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from hcbench.cli import run

pytestmark = pytest.mark.usefixtures("tuned_once")

EXAMPLES = Path(__file__).parents[2] / "examples"
PLUG_IN = """<mujoco><option timestep="0.002"/>
<extension><plugin plugin="hcbench.restitution"><instance name="bounce">
  <config key="body1" value="ball"/><config key="body2" value="world"/><config key="alpha" value="0.315"/>
</instance></plugin></extension>
<worldbody><geom name="plate" type="plane" size="1 1 1"/>
<body name="ball" pos="0 0 1"><freejoint/><geom name="ball" size=".05" mass="1"/>
<plugin instance="bounce"/></body></worldbody></mujoco>"""
PAIRS = "speed [m/s],restitution\n0.1,0.97\n0.2,0.94\n0.3,0.91\n0.4,0.885\n0.5,0.86\n"
BROKEN, GOOD = str(EXAMPLES / "broken.xml"), str(EXAMPLES / "good.xml")
FEW = ["--pair=ball,plate", "--speeds=0.2, 0.5 m/s", "--phases=1"]
COMMANDS = [
    ["measure", "plug.xml", *FEW],
    ["measure", "plug.xml", *FEW, "--alpha=0.3 +- 0.01 s/m", "--json"],
    ["measure", BROKEN, *FEW, "--restitution=0.9"],
    ["pairs", GOOD],
    ["check", GOOD, *FEW, "--restitution=0.9"],
    ["check", BROKEN, *FEW, "--alpha=0.3 +- 0.01 s/m"],
    ["tune", "mujoco", "--alpha=0.3 s/m", "--timestep=2 ms"],
    ["tune", GOOD, "--pair=ball,plate", "--restitution=0.9", "--max-error=1"],
    ["convert", "--alpha=0.3 s/m", "--speed=1 m/s"],
    ["law", "--alpha=0.008 s/in", "--speeds=0.2"],
    ["engines"],
    ["fit", "pairs.csv"],
    ["measure", GOOD, "--pair=ball,plat"],
    ["measure", GOOD, "--pair=ball,plate", "--speeds=x"],
]


@pytest.mark.parametrize("command", COMMANDS, ids=lambda c: " ".join(map(str, c))[:40])
def test_no_output_shows_the_repr_of_an_object(
    command: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plug.xml").write_text(PLUG_IN)
    (tmp_path / "pairs.csv").write_text(PAIRS)
    run(command)
    shown = capsys.readouterr()
    text = shown.out + shown.err
    assert text
    assert not re.findall(r"\w*\(\w+=[^)]*\)|<\w[\w.]* object|\bnp\.float|\barray\(", text)
