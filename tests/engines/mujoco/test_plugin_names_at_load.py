"""MuJoCo's plug-in names at load what a law cannot do in a model: meet, act, or let rest."""

from __future__ import annotations

import mujoco
import pytest

from hcbench.contact import mujoco as contact

PAIR = """
<mujoco>
  <worldbody>
    <body name="one" pos="0 0 1"><freejoint/>
      <geom name="a" size=".1" {a}/>
      <body name="two" pos="0 0 .3"><joint axis="1 0 0"/>
        <geom name="b" size=".1"/>
        <body pos="0 0 .3"><joint axis="1 0 0"/><geom name="c" size=".1"/></body>
      </body>
    </body>
    <geom name="floor" type="plane" size="2 2 .1"/>
  </worldbody>
  <contact>{contact}</contact>
  <extension><plugin plugin="hcbench.restitution"><instance name="law">
    <config key="geom1" value="{pair[0]}"/><config key="geom2" value="{pair[1]}"/>
    <config key="restitution" value=".5"/>
  </instance></plugin></extension>
</mujoco>"""


@pytest.mark.parametrize(
    ("pair", "contact_", "a", "words"),
    [
        (("a", "floor"), "", "", None),
        (("a", "c"), "", "", None),
        (
            ("a", "floor"),
            "",
            'contype="0" conaffinity="0"',
            "contype and conaffinity keep them apart",
        ),
        (
            ("a", "floor"),
            '<exclude body1="one" body2="world"/>',
            "",
            "an <exclude> of their bodies",
        ),
        (("a", "b"), "", "", "one's body is the parent of the other's"),
        (("a", "b"), '<pair geom1="a" geom2="b"/>', "", None),
    ],
)
def test_a_pair_that_never_meets_is_named_at_load(
    pair: tuple[str, str], contact_: str, a: str, words: str | None
) -> None:
    contact.load()
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        model = mujoco.MjModel.from_xml_string(PAIR.format(pair=pair, contact=contact_, a=a))
        mujoco.MjData(model)
    finally:
        mujoco.set_mju_user_warning(None)
    assert bool(warned) == (words is not None)
    if words is not None:
        assert words in warned[0]
        assert all(f'"{name}"' in warned[0] for name in (*pair, "law"))


FIELD = """
<mujoco>
  <asset>
    <mesh name="wedge" vertex="-.1 -.1 0 .1 -.1 0 -.1 .1 0 .1 .1 0 0 0 .1"/>
    <hfield name="field" nrow="3" ncol="3" size="1 1 .1 .1" elevation="0 1 0 1 0 1 0 1 0"/>
  </asset>
  <worldbody>
    <geom name="ground" type="hfield" hfield="field"/>
    <body name="one" pos="0 0 1"><freejoint/><geom name="thrown" {thrown} mass="1"/></body>
  </worldbody>
  <extension><plugin plugin="hcbench.restitution"><instance name="law">
    <config key="body1" value="world"/><config key="body2" value="one"/>
    <config key="restitution" value=".5"/>
  </instance></plugin></extension>
</mujoco>"""


def loaded(text: str, steps: int = 0) -> tuple[mujoco.MjModel, mujoco.MjData, list[str]]:
    """A model, its data after the steps, and what MuJoCo warned of until then."""
    contact.load()
    warned: list[str] = []
    mujoco.set_mju_user_warning(warned.append)
    try:
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=steps)
    finally:
        mujoco.set_mju_user_warning(None)
    return model, data, warned


@pytest.mark.parametrize("flag", ["contact", "constraint"])
@pytest.mark.parametrize("law", ["restitution", "hunt_crossley"])
def test_a_model_with_contacts_off_is_named_once_in_its_first_steps(law: str, flag: str) -> None:
    force = law == "hunt_crossley"
    text = PAIR.format(
        pair=("a", "floor"), contact="", a='contype="0" conaffinity="0"' if force else ""
    )
    text = text.replace("<worldbody>", f'<option><flag {flag}="disable"/></option><worldbody>')
    if force:
        text = text.replace("hcbench.restitution", "hcbench.hunt_crossley").replace(
            'key="restitution" value=".5"/>',
            'key="alpha" value=".3"/><config key="stiffness" value="1e5"/>',
        )
    _, _, warned = loaded(text, 20)
    words = f'no pair meets, as the model has <flag {flag}="disable"/>: enable it'
    assert warned == [f"plugin hcbench.{law}: {words}"]


def test_contacts_that_a_script_switches_off_for_a_while_are_not_named() -> None:
    model, data, warned = loaded(PAIR.format(pair=("a", "floor"), contact="", a=""))
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    mujoco.set_mju_user_warning(warned.append)
    try:
        mujoco.mj_step(model, data, nstep=20)
    finally:
        mujoco.set_mju_user_warning(None)
    assert warned == []


@pytest.mark.parametrize(
    ("thrown", "named"),
    [
        ('type="mesh" mesh="wedge"', True),
        ('type="ellipsoid" size=".1 .1 .05"', True),
        ('type="box" size=".1 .1 .1"', False),
    ],
)
def test_a_mesh_or_an_ellipsoid_on_a_height_field_is_named(thrown: str, named: bool) -> None:
    _, _, warned = loaded(FIELD.format(thrown=thrown))
    late = [words for words in warned if "whose contact MuJoCo finds late and deep" in words]
    assert late == warned
    assert bool(late) == named
    assert all('"ground"' in words and '"thrown"' in words for words in late)
