"""A robot's feet tuned by its landing: what is printed holds in a loop of plain MuJoCo, at heights
and phases that no search saw.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from long_searches import long_search

import hcbench as hb
from hcbench.cli import run
from hcbench.cli.tune_model import _next_line, landing_table
from hcbench.measuring import Wanted
from hcbench.measuring.request import make_request
from hcbench.sim import registry
from hcbench.sim.capabilities import TunesModels
from hcbench.sim.landing import (
    DROPS,
    HEIGHTS,
    MANY_REBOUNDS,
    PHASES,
    QUANTITIES,
    DropTest,
    Reach,
    drop_test,
)
from hcbench.sim.model_under_test import ModelSetting, Output
from hcbench.sim.rest import UNKNOWN
from hcbench.system.errors import UserError
from hcbench.tuning.landing import tune_landing
from hcbench.tuning.model import _best, _Try, _TuneSearch
from hcbench.tuning.tuned_model import LandingChange

mujoco = pytest.importorskip("mujoco")

from robot_drops import FEET, QUADRUPED, drop  # noqa: E402

from hcbench.engines.mujoco.model.foot_springs import (  # noqa: E402
    FootContact,
    rebound_settings,
    write_contact,
)
from hcbench.engines.mujoco.model.write_pairs import texts_of  # noqa: E402

pytestmark = pytest.mark.usefixtures("tuned_once")

UNSEEN = (0.07, 0.39, 0.61, 0.88)


@cache
def tuned(**target: Any) -> hb.TunedModel:
    return hb.tune_model(QUADRUPED, FEET, **target)


@pytest.mark.parametrize("rebound", [pytest.param(0.005, marks=long_search), 0.02])
def test_the_centre_of_mass_rebounds_by_the_target_at_phases_that_no_search_saw(
    rebound: float,
) -> None:
    found = tuned(rebound=rebound)
    assert found.gains
    assert found.landing is not None
    assert not set(UNSEEN) & set(PHASES)
    model = mujoco.MjModel.from_xml_string(found.written)
    seen = [drop(model, max(HEIGHTS), phase, 1.0).rebound for phase in UNSEEN]
    assert np.mean(seen) == pytest.approx(rebound, rel=0.1)
    assert np.mean(seen) == pytest.approx(found.landing.after.rebound, rel=0.05)


def test_nine_of_ten_rebounds_are_within_the_spread_that_is_printed() -> None:
    """The range of four phases, which the search saw, left out more."""
    found = tuned(rebound=0.02)
    assert found.landing is not None
    after = found.landing.after
    assert after.phases == len(MANY_REBOUNDS)
    model = mujoco.MjModel.from_xml_string(found.written)
    phases = np.random.default_rng(42).uniform(size=20).tolist()
    seen = [drop(model, max(HEIGHTS), phase, 0.6).rebound for phase in phases]
    within = [abs(one - after.rebound) <= after.spread for one in seen]
    assert np.mean(within) >= 0.9


def test_nothing_else_is_worse_at_heights_and_tilts_that_no_search_saw() -> None:
    found = tuned(rebound=0.02)
    before = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    after = mujoco.MjModel.from_xml_string(found.written)
    for height, phase, tilt in ((0.035, 0.39, 0.0), (0.07, 0.61, -0.05)):
        was, now = (drop(model, height, phase, 3.0, tilt) for model in (before, after))
        assert now.rest < max(1.2 * was.rest, was.rest + 0.3)
        assert now.peak < max(1.5 * was.peak, was.peak + 2.0)
        assert now.depth < max(1.2 * was.depth, was.depth + 5e-4)
        assert now.travel < max(1.5 * was.travel, was.travel + 0.02)


def test_the_judge_agrees_with_a_plain_loop() -> None:
    """The model as it is: the worst of one height, flat."""
    landing = tuned(rebound=0.02).landing
    assert landing is not None
    model = mujoco.MjModel.from_xml_path(str(QUADRUPED))
    seen = [drop(model, 0.1, phase, 2.0) for phase in PHASES]
    assert max(one.depth for one in seen) <= landing.before.depth * 1.001
    assert max(one.depth for one in seen) > landing.before.depth * 0.8
    assert max(one.peak for one in seen) <= landing.before.peak * 1.001
    assert max(one.rest for one in seen) <= landing.before.rest + 0.01
    assert landing.before.rebound == pytest.approx(np.mean([one.rebound for one in seen]), abs=1e-6)


def test_an_e_of_0_of_a_robot_that_does_not_rebound_leaves_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    pairs = [word for pair in FEET for word in ("--pair", pair)]
    assert run(["tune", str(QUADRUPED), *pairs, "--restitution", "0"]) == 0
    assert "has this rebound already: there is nothing to paste" in capsys.readouterr().out


@pytest.mark.parametrize("asked", ["5 ms", None])
def test_the_step_of_a_rebound_is_written_with_the_feet(asked: str | None) -> None:
    requests = [make_request(pair, timestep=asked) for pair in FEET]
    made = write_contact(QUADRUPED, requests, FootContact(100.0, 0.5, impratio=10.0))
    texts = texts_of(QUADRUPED, made, (), Output())
    own = mujoco.MjModel.from_xml_path(str(QUADRUPED)).opt.timestep
    step = own if asked is None else 5e-3
    whole = mujoco.MjModel.from_xml_string(texts.written)
    assert (whole.opt.timestep, whole.opt.impratio) == (step, 10.0)
    assert ("timestep" in texts.paste) == (asked is not None)


def test_the_gravity_of_a_rebound_is_written_with_the_feet() -> None:
    requests = [make_request(pair, gravity=1.62) for pair in FEET]
    made = write_contact(QUADRUPED, requests, FootContact(100.0, 0.5))
    texts = texts_of(QUADRUPED, made, (), Output())
    whole = mujoco.MjModel.from_xml_string(texts.written)
    assert whole.opt.gravity.tolist() == [0.0, 0.0, -1.62]
    assert '<option gravity="0 0 -1.62"/>' in texts.paste
    assert "gravity is now 1.62 m/s^2" in made.kept


def test_a_mean_of_phases_that_rebound_and_phases_that_do_not_is_no_rebound(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """5 mm +- 5 mm was handed out as 5 mm."""
    good = tuned(rebound=0.02)
    assert good.landing is not None
    after = dataclasses.replace(good.landing.after, rebound=0.0205, spread=0.0201)
    assert after.is_near(0.02)
    assert not after.meets(0.02)
    assert dataclasses.replace(after, spread=0.01).meets(0.02)
    change = LandingChange(good.landing.before, after, 0.02)
    found = dataclasses.replace(good, landing=change)
    monkeypatch.setattr("hcbench.tuning.ask.tune_job", lambda *_: found)
    pairs = [word for pair in FEET for word in ("--pair", pair)]
    out = tmp_path / "tuned.xml"
    asked = ["tune", str(QUADRUPED), *pairs, "--rebound", "20 mm", "--write-model", str(out)]
    assert run(asked) == 1
    captured = capsys.readouterr()
    assert "nothing written" in captured.out
    assert "a rebound of 20.5 mm that varies by 20 mm with where in a step" in captured.err
    assert not out.exists()


def test_feet_that_no_pair_names_are_named_where_one_alone_is_tuned() -> None:
    """A smaller step was advised, with which one foot of four throws the robot up no higher."""
    landing = tuned(rebound=0.02).landing
    assert landing is not None

    def advice(pairs: list[str]) -> tuple[str, ...]:
        requests = [make_request(pair) for pair in pairs]
        return rebound_settings(QUADRUPED, requests, landing.before, 0.02).advice

    (said,) = advice(FEET[:1])
    assert said.startswith("Other parts stand on the floor, too: ")
    command = said.partition("Name them all: ")[2].removesuffix(".").split()
    assert sorted(command[1::2]) == sorted(FEET)
    assert advice(FEET) == ()


@long_search
def test_a_rebound_out_of_reach_is_refused_with_the_largest_one_and_what_would_help(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    pairs = [word for pair in FEET for word in ("--pair", pair)]
    out = tmp_path / "tuned.xml"
    asked = ["tune", str(QUADRUPED), *pairs, "--rebound", "90 mm", "--write-model", str(out)]
    assert run([*asked, "--json"]) == 1
    captured = capsys.readouterr()
    record = json.loads(captured.out)["landing"]
    assert 0.02 < record["reach"]["rebound_m"] < 0.09
    assert record["reach"]["stiffer"][0]["kp_factor"] == 2.0
    largest = f"{1e3 * record['reach']['rebound_m']:.3g} mm"
    assert f"largest rebound up to 90 mm without a worse landing is {largest}" in captured.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"rebound": "5 m"}, "less than the drop"),
        ({"rebound": "5 mm", "restitution": 0.5}, "one target"),
        ({"rebound": "-1 mm"}, "0"),
    ],
)
def test_what_is_no_rebound_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        tuned(**given)


@pytest.mark.parametrize(
    ("was", "target", "reached", "phrase"),
    [
        (0.0, 0.09, 0.03, "largest rebound up to 90 mm"),
        (0.012, 0.0, 0.004, "smallest rebound"),
        (0.002, 0.005, 0.019, "nearest rebound"),
        (0.012, 0.005, 0.002, "nearest rebound"),
    ],
)
def test_a_refusal_names_the_end_of_what_is_possible_on_the_side_of_the_target(
    was: float, target: float, reached: float, phrase: str
) -> None:
    landing = tuned(rebound=0.02).landing
    assert landing is not None
    before = dataclasses.replace(landing.before, rebound=was)
    change = LandingChange(before, before, target, Reach(reached))
    said = f"the {phrase} without a worse landing is {1e3 * reached:g} mm"
    assert (change.extreme, change.misses) == (phrase, said)


def test_a_rigid_body_has_no_rebound_beside_its_e() -> None:
    good = QUADRUPED.with_name("good.xml")
    with pytest.raises(UserError, match=r"'ball' is one rigid body.*e squared times the drop"):
        hb.tune_model(good, "ball,plate", rebound="5 mm")


def worse(test: DropTest) -> DropTest:
    return dataclasses.replace(test, depth=2.0 * test.depth, late=3.0)


def test_a_landing_is_worse_in_what_grew_by_more_than_is_stated() -> None:
    landing = tuned(rebound=0.02).landing
    assert landing is not None
    was = landing.before
    deeper = f"largest penetration {1e3 * was.depth:.3g} -> {2e3 * was.depth:.3g} mm"
    assert list(worse(was).worse_than(was)) == [deeper, "flights after 3 s 0 -> 3"]
    for quantity in QUANTITIES:
        then = getattr(was, quantity.name)
        limit = max(quantity.share * then, then + quantity.slack)
        at_limit = dataclasses.replace(was, **{quantity.name: limit})
        assert not list(at_limit.worse_than(was))
        beyond = dataclasses.replace(was, **{quantity.name: 1.001 * limit + 1e-9})
        assert len(list(beyond.worse_than(was))) == 1
    never = dataclasses.replace(was, rest=math.inf)
    assert list(never.worse_than(was)) == [f"time to rest {was.rest:.3g} -> never"]
    assert not list(never.worse_than(never))


def test_a_drop_that_diverged_is_said_to_in_each_line_of_the_table() -> None:
    """The table said "never" of its infinite depth, too."""
    landing = tuned(rebound=0.02).landing
    assert landing is not None
    was = landing.before
    lost = drop_test(was.robot, {DROPS[0]: None}, was.seconds)
    _, *lines = landing_table(LandingChange(was, lost))
    assert all(line.endswith("  diverged") for line in lines)
    never = dataclasses.replace(was, rest=math.inf)
    _, _, rest, *others = landing_table(LandingChange(was, never))
    assert rest.split()[-1] == "never"
    assert not any("never" in line or "diverged" in line for line in others)


def test_a_robot_whose_own_drops_have_no_end_is_refused() -> None:
    """The table was one of "diverged", and the smallest rebound "inf mm"."""
    landing = tuned(rebound=0.02).landing
    assert landing is not None
    lost = drop_test(landing.before.robot, {DROPS[0]: None}, landing.before.seconds)
    engine = registry.engine("mujoco")
    assert isinstance(engine, TunesModels)
    with pytest.raises(UserError, match=r"never lands.*smaller --timestep"):
        tune_landing(engine, QUADRUPED, [make_request(FEET[0])], lost, 0.02, Output())


@cache
def ball() -> hb.TunedModel:
    good = QUADRUPED.with_name("good.xml")
    return hb.tune_model(good, "ball,plate", restitution=0.5, speeds="0.5, 1 m/s")


def test_a_model_that_is_written_beyond_the_limit_is_said_to_be_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The exit code was 1, and no line said that the file is there."""
    found = ball()
    monkeypatch.setattr("hcbench.tuning.ask.tune_job", lambda *_: found)
    out = tmp_path / "tuned.xml"
    asked = ["tune", str(QUADRUPED.with_name("good.xml")), "--pair", "ball,plate"]
    asked += ["--restitution", "0.5", "--max-error", "0", "--write-model", str(out)]
    assert run(asked) == 1
    assert out.exists()
    assert f"written: {out}" in "".join(capsys.readouterr().out.splitlines())


def test_a_model_whose_text_cannot_stay_says_that_it_includes_no_file(tmp_path: Path) -> None:
    """The geoms have no names in the user's text: both files held the lines, without a word."""
    text = QUADRUPED.with_name("good.xml").read_text(encoding="utf-8")
    model = tmp_path / "good.xml"
    model.write_text(text.replace('<geom name="ball"', "<geom"), encoding="utf-8")
    out = tmp_path / "out.xml"
    made = hb.tune_model(
        model, "ball,plate", restitution=0.5, speeds="0.5, 1 m/s",
        write_model=out, write_include=tmp_path / "pairs.xml",
    )  # fmt: skip
    assert "<include" not in out.read_text(encoding="utf-8")
    assert made.notes[-1].startswith("out.xml has the lines itself and does not include pairs.xml")


class Lands:
    """Stands in for an engine: settings whose source is "worse" land worse.

    briefly: of each test that it was asked for, whether one drop would do.
    """

    def __init__(self) -> None:
        self.briefly: list[bool] = []

    def landing(self, source: Any, requests: Any, like: DropTest, until_worse: bool) -> DropTest:
        self.briefly.append(until_worse)
        return worse(like) if source == "worse" else like


def a_try(name: str, source: Any, error: float, *, bounces: bool = True) -> Any:
    (pair,) = ball().pairs
    pairs = (pair if bounces else dataclasses.replace(pair, failure="has no e: turned back"),)
    setting = ModelSetting(name, (), Any, Any, source=source)  # type: ignore[arg-type]
    return _Try(setting, UNKNOWN, error, 0, throws_up=False, pairs=pairs)


def chosen(
    *tries: Any, landed: bool = False, limit: float = 1.0, engine: Lands | None = None
) -> Any:
    was = tuned(rebound=0.02).landing
    assert was is not None
    before = was.before if landed else None
    search = _TuneSearch(
        engine=engine or Lands(),  # type: ignore[arg-type]
        source=None,
        requests=[],
        attitudes=[],
        wanted=Wanted(restitution=0.5),
        max_error=limit,
        as_it_was=Any,  # type: ignore[arg-type]
        before=UNKNOWN,
        landed=before,
    )
    return _best(search, tries, limit, enough=0.0)


def test_a_setting_without_a_bounce_is_passed_over() -> None:
    silent, bounces = a_try("silent", None, 0.1, bounces=False), a_try("bounces", None, 0.2)
    assert chosen(silent, bounces).setting.name == "bounces"
    with pytest.raises(UserError, match="the setting 'silent', has no e: turned back"):
        chosen(silent)


HELD = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body name="bob" pos="0 0 .3"><joint name="z" type="slide" axis="0 0 1" stiffness="4000" damping="400"/>
<geom name="bob" type="sphere" size=".1" mass="1"/></body></worldbody></mujoco>"""


def test_a_launch_that_never_touches_is_refused_after_one_setting() -> None:
    """Servos that hold a leg back cost minutes of search for a contact, then exit code 3."""
    with pytest.raises(UserError, match=r"at 0\.1 m/s has no e: turned back.*springs"):
        hb.tune_model(HELD, "bob,floor", restitution=0.5, speeds="0.1:0.2 m/s")


def test_a_setting_with_which_the_robot_lands_worse_gives_way_to_one_that_gains() -> None:
    bad, good = a_try("bad", "worse", 0.1), a_try("good", "good", 0.2)
    assert chosen(bad, good, landed=True).setting.name == "good"
    assert chosen(bad, landed=True).landing.worse
    assert chosen(bad, good, landed=True, limit=0.0).setting.name == "bad"


def test_one_drop_is_enough_where_something_is_worse_in_it() -> None:
    """Drops of 0.4 s: a robot as it is, compared with itself and with one of a softer landing."""
    engine = registry.engine("mujoco")
    assert isinstance(engine, TunesModels)
    requests = [make_request(FEET[0])]
    landed = tuned(rebound=0.02).landing
    assert landed is not None
    brief = dataclasses.replace(landed.before, seconds=0.4)
    like = engine.landing(QUADRUPED, requests, brief)
    assert not [*engine.landing(QUADRUPED, requests, like, True).worse_than(like)]
    softer = dataclasses.replace(like, peak=like.peak / 2)
    one = engine.landing(QUADRUPED, requests, softer, True)
    every = engine.landing(QUADRUPED, requests, softer)
    assert [*one.worse_than(softer)] and [*every.worse_than(softer)]
    assert math.isnan(one.rebound) and not math.isnan(every.rebound)  # one tilted drop; all 24


def test_only_a_landing_that_is_shown_is_tested_whole() -> None:
    bad, silent = a_try("bad", "worse", 0.1), a_try("silent", "worse", 0.1, bounces=False)
    engine = Lands()
    assert chosen(bad, a_try("second", "worse", 0.2), landed=True, engine=engine).landing.worse
    assert engine.briefly == [False, True]
    engine = Lands()
    shown = chosen(silent, a_try("second", "worse", 0.2), landed=True, engine=engine)
    assert shown.setting.name == "second" and shown.landing.worse
    assert engine.briefly == [False, True, False]


@pytest.fixture
def landing_worse(tuned_once: None, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """`tune` finds a setting with which a robot lands worse."""
    was = tuned(rebound=0.02).landing
    assert was is not None
    change = LandingChange(was.before, worse(was.before))
    found = dataclasses.replace(ball(), landing=change)
    monkeypatch.setattr("hcbench.tuning.ask.tune_job", lambda *_: found)
    yield


@pytest.mark.usefixtures("landing_worse")
def test_a_worse_landing_is_printed_with_its_lines_and_not_written(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    out = tmp_path / "tuned.xml"
    asked = ["tune", str(QUADRUPED), "--pair", FEET[0], "--alpha", "0.3 s/m"]
    assert run([*asked, "--write-model", str(out)]) == 1
    captured = capsys.readouterr()
    assert "Worse than before: largest penetration 19 -> 38.1 mm" in " ".join(captured.out.split())
    assert "<pair geom1=" in captured.out
    assert "landing: the robot lands worse with it: largest penetration" in captured.err
    assert not out.exists()


# A trunk on a rail, over a foot on a spring: no actuator drives it.
SPRUNG = """<mujoco><option timestep="2e-3"/><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
<body name="trunk" pos="0 0 .6"><joint type="slide" axis="0 0 1"/>
 <geom type="box" size=".1 .05 .05" mass="3"/>
 <body pos="0 0 -.1"><joint type="slide" axis="0 0 1" range="-.2 .2" stiffness="800" damping="12"/>
  <geom name="foot" type="sphere" pos="0 0 -.25" size=".02" mass=".4"/></body></body>
</worldbody></mujoco>"""


SOFT = """<mujoco><worldbody><geom name="floor" type="plane" size="2 2 .1"/>
<body pos="0 0 .3"><freejoint/><geom name="ball" type="sphere" size=".05" mass=".2"/></body>
</worldbody></mujoco>"""


@long_search
def test_a_hopper_on_springs_is_judged_as_it_lands(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A foot that stops made it land with three times the force, and was written."""
    (tmp_path / "hopper.xml").write_text(SPRUNG)
    out = tmp_path / "tuned.xml"
    asked = ["tune", str(tmp_path / "hopper.xml"), "--pair", "foot,floor", "--restitution", "0"]
    assert run([*asked, "--write-model", str(out)]) == 1
    said = capsys.readouterr()
    assert "worst of 12 drops, except rebound" in said.out
    assert "rebound from 10 cm, mm, mean of 12 flat" in said.out
    assert "the smallest rebound without a worse landing is" in said.err
    assert not out.exists()


def test_the_next_line_has_the_speeds_of_the_launches_not_those_at_touch() -> None:
    found = hb.tune_model(SOFT, "ball,floor", restitution=0.9, speeds="0.5:2 m/s")
    low, _ = found.pairs[0].band
    assert low > 0.505
    given = {"restitution": 0.9, "material": None, "pair": ["ball,floor"]}
    assert '--speeds "0.5:2:5 m/s"' in _next_line(found, 0.05, "soft.xml", None, given)


def test_a_setting_with_which_a_launch_gains_energy_is_not_written() -> None:
    found = ball()
    assert found.gains
    (pair,) = found.pairs
    lively = dataclasses.replace(
        found, name="lively", pairs=(dataclasses.replace(pair, highest=1.01),)
    )
    assert not lively.gains
    assert lively.no_gain == "e up to 1.01 with 'lively': it gains energy"
