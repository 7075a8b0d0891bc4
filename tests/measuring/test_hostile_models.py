"""Models that nobody means: a sentence that names the cause, and no number that is none."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import hcbench as hb
from hcbench.cli import run
from hcbench.measuring import measure
from hcbench.measuring.request import make_request
from hcbench.system.errors import HcbenchError, QuantityError, SceneError, UserError
from hcbench.terms.bounds import beyond_bounds

MODEL = """<mujoco><option timestep="1e-3" gravity="0 0 -9.81"/><worldbody>
<geom name="plate" type="plane" size="1 1 1" solref="{solref}"/><body name="ball" pos="0 0 1"><freejoint/>
<geom name="ball" type="sphere" size="0.1" mass="1" solref="{solref}"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("solref", "cause"),
    [("-1e300 -1", "too stiff for the step"), ("1e300 1", "still in contact, and not at rest")],
)
def test_a_model_whose_every_launch_fails_could_not_be_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], solref: str, cause: str
) -> None:
    (tmp_path / "m.xml").write_text(MODEL.format(solref=solref))
    assert run(["measure", str(tmp_path / "m.xml"), "--pair=ball,plate", "--speeds=0.3"]) == 3
    message = capsys.readouterr().err
    assert "every launch of ball on plate failed" in message
    assert cause in message


def test_in_python_the_result_says_why_it_has_no_e() -> None:
    shown = repr(hb.measure(MODEL.format(solref="-1e300 -1"), "ball,plate", speeds=0.3))
    assert "every launch of ball on plate failed" in shown
    assert "nan" not in shown


def test_a_file_name_outside_utf8_is_refused_in_one_line(tmp_path: Path) -> None:
    name = os.fsdecode(os.fsencode(tmp_path) + b"/m\xff.xml")
    Path(name).write_text(MODEL.format(solref="-1000 -1"))
    with pytest.raises(SceneError, match="has a byte that is not UTF-8; expected a name in UTF-8"):
        hb.pairs(name)


@pytest.mark.parametrize("given", [0.3, {}, True, [1, 2], "1,2"])
def test_a_spring_that_is_none_is_refused_by_its_name(given: Any) -> None:
    for name in ("adams", "newton"):
        options: dict[str, Any] = {name: given}
        with pytest.raises(UserError, match=f"^{name}: "):
            hb.convert(**options, mass=1.0, speed=1.0)
        with pytest.raises(UserError, match=f"^{name}: "):
            hb.tune("mujoco", timestep=1e-3, **options)


def test_a_zipped_model_is_the_model_and_a_damaged_one_is_refused(tmp_path: Path) -> None:
    path, model = tmp_path / "good.mjz", Path(__file__).parents[2] / "examples" / "good.xml"
    with path.open("wb") as file:
        mujoco.MjSpec.from_file(str(model)).to_zip(file)
    assert str(hb.pairs(path)).replace(".mjz", ".xml") == str(hb.pairs(model))
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(SceneError, match="not a zip file"):
        hb.pairs(path)


def test_arguments_that_name_no_file_are_refused() -> None:
    with pytest.raises(SceneError, match="expected a file"):
        hb.pairs([None], engine="mujoco")
    with pytest.raises(UserError, match=r"null (byte|character)"):
        hb.fit("a\0b")


def test_a_binary_model_whose_sizes_ask_for_gigabytes_is_refused(tmp_path: Path) -> None:
    """MuJoCo would take up to 19 GB for a file of 5 KB before it
    finds out that its sizes are wrong.
    """
    path = tmp_path / "model.mjb"
    mujoco.mj_saveModel(mujoco.MjModel.from_xml_string(MODEL.format(solref="0.02 1")), str(path))
    sound = path.read_bytes()
    listed = str(hb.pairs(path))
    sizes = np.frombuffer(sound[:400], dtype=np.int32)
    said = set()
    for place in np.flatnonzero((sizes > 0) & (sizes < 100))[:12]:
        content = bytearray(sound)
        content[4 * place + 3] = 0x10  # the highest byte of a size: 268 million more
        path.write_bytes(content)
        try:
            # Some versions of MuJoCo have sizes that they work out anew.
            assert str(hb.pairs(path)) == listed
        except SceneError as refused:
            said.add(str(refused).partition(": ")[2].partition(": ")[2])
    assert any("more memory than the file has numbers for" in words for words in said)


def test_a_part_beyond_all_bounds_leaves_no_log_of_the_engines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "far.xml").write_text(
        '<mujoco><worldbody><geom name="floor" type="plane" size="2 2 .1"/><body name="ball" pos="0 0 1">'
        '<freejoint/><geom name="ball" size=".05" pos="1e20 0 0"/></body></worldbody></mujoco>'
    )
    with pytest.raises(UserError, match=r"position of a geom: 1e\+20 m; expected 0 ... 10000 m"):
        measure("far.xml", "ball,floor", speeds=[1.0], phases=1)
    with beyond_bounds(), suppress(HcbenchError):
        measure("far.xml", "ball,floor", speeds=[1.0], phases=1)
    assert [path.name for path in tmp_path.iterdir()] == ["far.xml"]


def test_gravity_of_three_numbers_needs_commas() -> None:
    with pytest.raises(QuantityError, match=r"commas between the three: '0, 0, -9\.81'"):
        make_request(gravity="0 0 -9.81")
    assert make_request(gravity="0, 0, -9.81").gravity == (0.0, 0.0, -9.81)


def test_a_foot_above_its_floor_by_rounding_has_a_mass_and_is_the_first_pair() -> None:
    """Nearest points 1e-16 m apart had no direction, and the next line named a hull that cannot land."""
    foot = '<geom name="foot" pos="0 0 -.25" size=".05" mass=".3"/>'
    hull = '<geom name="hull" type="box" size=".1 .05 .05" mass="3"/>'
    body = f'<body pos="0 0 .3000000000000001"><freejoint/>{hull}{foot}</body>'
    floor = '<geom name="floor" type="plane" size="2 2 .1"/>'
    listed = hb.pairs(f"<mujoco><worldbody>{floor}{body}</worldbody></mujoco>")
    assert 0.0 < listed[0].distance < 1e-15
    assert listed[0].pair == "foot,floor"
    assert math.isfinite(listed[0].effective_mass)


def test_a_plugin_that_is_not_there_is_installed_by_the_named_command() -> None:
    text = '<mujoco><extension><plugin plugin="hcbench.unknown"/></extension></mujoco>'
    with pytest.raises(SceneError, match="`hcbench plugin mujoco --install`"):
        hb.pairs(text)
