"""A user's MuJoCo model that another engine steps is prepared and read as
MuJoCo's own; here MuJoCo steps.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import mujoco
import numpy as np
import pytest
from shared_models import HOPPER, PAIR, SPRING, ball

from hcbench.engines.mujoco.model.open import load
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.scene.shared_scene import differences
from hcbench.measuring.diagnose import diagnose, goal_of
from hcbench.measuring.request import make_request
from hcbench.sim import registry, shared_model, simulate
from hcbench.sim.capabilities import opener
from hcbench.sim.columns import Launches
from hcbench.sim.model_under_test import ModelUnderTest
from hcbench.sim.shared_model import Copies, SharedModelEngine
from hcbench.system.errors import SettingError
from hcbench.terms.impact import Floats, Impact, Launch, Status
from hcbench.terms.scene import load_scene
from hcbench.terms.setting import Pair, Setting

SPEEDS = [0.07, 0.33, 0.9]
STIFF = PAIR.format('solref="0 -1900" solimp=".9999 .9999 .001"')


class MujocoCopies(Copies):
    """MuJoCo itself, a model for each copy, in numbers of so many bits."""

    places = 8

    def __init__(self, model: Any, start: Any, bits: int) -> None:
        self.model, self.bits, self.start = model, bits, start

    def place(self, states: Floats) -> Floats:
        self.data = [mujoco.MjData(self.model) for _ in states]
        for data in self.data:
            data.ctrl[:] = self.start.ctrl
        return self.put(states)

    def put(self, states: Floats) -> Floats:
        states = states.astype(f"f{self.bits // 8}").astype(float)
        for data, state in zip(self.data, states, strict=True):
            data.qpos[:], data.qvel[:] = np.split(state, [self.model.nq])
        return states

    def step(self, steps: int) -> Floats:
        path = []
        for _ in range(min(steps, 7)):
            for data in self.data:
                mujoco.mj_step(self.model, data)
            states = np.array([np.append(data.qpos, data.qvel) for data in self.data])
            path.append(self.put(states) if self.bits == 32 else states)
        return np.array(path)


class ItselfEngine(SharedModelEngine):
    """MuJoCo under another name."""

    name = "itself"
    title = "Itself"
    model_engine = "mujoco"

    def __init__(self, bits: int = 64, lacks: frozenset[str] = frozenset()) -> None:
        self.own_bits, self.lacks = bits, lacks

    def version(self) -> str:
        return "1.0"

    def law_lines(self, law: Any, pair: Pair = ("ball", "plate")) -> str:
        return ""

    def copies(self, model: Any, start: Any, *_: Any) -> Copies:
        if "adhesion" in self.lacks:
            model = mujoco.MjModel.from_xml_string(ball("Euler", SPRING))
        return MujocoCopies(model, start, self.own_bits)


def both(
    xml: str, pair: str, engine: ItselfEngine, **asked: Any
) -> tuple[MujocoModel, ModelUnderTest]:
    """The model in MuJoCo, and the same model stepped by another engine."""
    request = make_request(pair, **{"speeds": SPEEDS, "phases": [0.1, 0.7], **asked})
    own, shared = (MujocoModel(*load(xml, request), request) for _ in range(2))
    return own, shared.stepped_by(engine)


def impacts(model: ModelUnderTest, **asked: Any) -> list[Impact]:
    request = make_request(None, **{"speeds": SPEEDS, "phases": [0.1, 0.7], **asked})
    return simulate.impacts_in(model, request.launches())


def without_loop(impact: Impact) -> tuple[Any, ...]:
    """Fields of an impact as a tuple: from Python 3.13 a dataclass with
    a NaN is not equal to its copy.
    """
    return dataclasses.astuple(dataclasses.replace(impact, loop=None))


def require_same(some: list[Impact], others: list[Impact]) -> None:
    for one, other in zip(some, others, strict=True):
        assert one.status is Status.PARTED
        assert without_loop(one) == without_loop(other)
        assert one.loop is not None
        assert other.loop is not None
        assert np.array_equal(one.loop.force, other.loop.force)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast", "RK4"])
def test_a_shared_ball_bounces_to_the_bit_as_in_mujoco(integrator: str) -> None:
    own, shared = both(ball(integrator), "ball,plate", ItselfEngine())
    require_same(impacts(shared), impacts(own))
    assert shared.facts().shares == own.facts().shares


def test_a_shared_robot_keeps_its_controls_and_its_loop() -> None:
    own, shared = both(HOPPER, "foot,floor", ItselfEngine())
    require_same(impacts(shared), impacts(own))
    assert shared.facts().shares == own.facts().shares
    assert (shared.facts().engine, shared.facts().version) == ("itself", "1.0")


def test_a_shared_body_slides_and_spins_as_in_mujoco() -> None:
    sent = {"angle": "50 deg", "spin": 20.0}
    own, shared = both(ball(), "ball,plate", ItselfEngine(), **sent)
    require_same(impacts(shared, **sent), impacts(own, **sent))


def test_float32_is_read_to_its_own_precision_and_scatters_where_it_must() -> None:
    own, shared = both(ball(), "ball,plate", ItselfEngine(32))
    e = np.array([[i.restitution for i in impacts(model)] for model in (own, shared)])
    assert 0 < np.abs(np.diff(e, axis=0)).max() < 2e-5
    assert not [
        s.code for s in shared.suspects(impacts(shared), None) if s.code == "rounded-positions"
    ]
    short = {"timestep": 5e-6, "speeds": 0.07, "phases": [0.5]}
    own, shared = both(ball(), "ball,plate", ItselfEngine(32), **short)
    (found,) = [
        s for s in shared.suspects(impacts(shared, **short), None) if s.code == "rounded-positions"
    ]
    assert "3.5e-07 m where coordinates of 0.05 m are 3.7e-09 m apart" in found.evidence
    with pytest.raises(
        SettingError, match=r"1e-06 s in float32: at 0\.9 m/s .* 9e-07 m; .*Use 4.3e-06"
    ):
        both(ball(height=9.0), "ball,plate", ItselfEngine(32), timestep=1e-6)


@pytest.mark.adhesion
def test_what_an_engine_drops_is_named_and_seen_in_its_bounce() -> None:
    pulls = PAIR.format('solref="-90000 -200" adhesion="1e9"')
    _, shared = both(ball(pairs=pulls), "ball,plate", ItselfEngine(lacks=frozenset({"adhesion"})))
    seen = impacts(shared)
    causes, _ = diagnose(shared, seen, goal_of((), SPEEDS, None))
    assert [cause.code for cause in causes[:2]] == ["adhesion-dropped", "unlike-mujoco"]
    assert causes[0].evidence == "adhesion of up to 1e+09 N"
    assert f"e at 0.07 m/s: {seen[1].restitution:.4g}, where MuJoCo has" in causes[1].evidence


@pytest.mark.parametrize(
    ("pairs", "lacks", "bits", "code"),
    [
        (SPRING * 2, "several pairs", 64, "pairs-dropped"),
        (
            PAIR.format('solref="0 -1900" solimp=".9999 .9999 .001"'),
            "impedance in float32",
            32,
            "impedance-rounding",
        ),
        (
            PAIR.format('solref="-1e8 -9" solimp=".0001 .9999 .0001 .5 1017"'),
            "",
            32,
            "power-underflow",
        ),
    ],
)
def test_a_contact_that_becomes_another_is_named(
    pairs: str, lacks: str, bits: int, code: str
) -> None:
    model = mujoco.MjModel.from_xml_string(ball(pairs=pairs))
    (found,) = differences(model, ItselfEngine(lacks=frozenset({lacks})), bits)
    assert found.code == code
    assert (
        differences(
            mujoco.MjModel.from_xml_string(ball()), ItselfEngine(lacks=frozenset({lacks})), bits
        )
        == []
    )


@pytest.mark.adhesion
def test_an_adhesion_that_float32_forgets_a_force_beside_is_held_to_its_size() -> None:
    pulls = PAIR.format('solref="-90000 -20" adhesion="{}"')
    for adhesion, codes in (("1e4", []), ("1e6", ["adhesion-rounding"])):
        _, shared = both(ball(pairs=pulls.format(adhesion)), "ball,plate", ItselfEngine(32))
        found = [s for s in shared.suspects(impacts(shared), None) if s.code.startswith("adhesion")]
        assert [suspect.code for suspect in found] == codes
    model = mujoco.MjModel.from_xml_string(ball(pairs=pulls.format("1e6")))
    assert found[0].apply is not None
    found[0].apply(model)
    force = max(impact.force_max for impact in impacts(shared))
    assert model.pair_adhesion[0] == pytest.approx(2 * force, rel=0.06)


def test_the_fix_for_an_impedance_is_one_that_float32_keeps() -> None:
    model = mujoco.MjModel.from_xml_string(ball(pairs=STIFF))
    lacks = frozenset({"impedance in float32"})
    (found,) = differences(model, ItselfEngine(lacks=lacks), 32, (0, 1))
    assert found.apply is not None
    found.apply(model)
    assert model.pair_solimp[0, :2].tolist() == [0.9, 0.9]
    assert differences(model, ItselfEngine(lacks=lacks), 32, (0, 1)) == []


def test_an_engine_that_steps_shared_models_is_chosen_by_name_only() -> None:
    for name in ("mjx", "mujoco-warp"):
        engine = opener(registry.engine(name))
        assert ".xml" in engine.suffixes
        assert not engine.accepts("model.xml")


@pytest.mark.parametrize("bits", [64, 32])
def test_balls_read_while_they_are_stepped_are_those_of_a_record_to_the_bit(
    bits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shared_model, "_WIDTH", 2)  # so that the last ones begin again on their own
    scene, setting = (
        dataclasses.replace(load_scene("steel-plane"), gravity=9.81),
        Setting(
            "itself",
            "mine",
            1e-4,
            {"rows": [{"solref": [-1e5, -50.0], "solimp": [0.9, 0.9, 0.001, 0.5, 2.0]}]},
        ),
    )
    speeds, phases = np.linspace(0.05, 0.5, 8), np.linspace(0.0, 0.8, 5)
    launches = [Launch(v, p) for v in speeds for p in phases]
    launches[3] = Launch(0.1, 0.5, height=0.03)  # falls ten times as long as the others take
    with ItselfEngine(bits).load(scene, setting, 1.0) as world:
        theirs = simulate.impacts_in(world, launches)
        mine = world.read(Launches.of(launches))
    assert all(impact.status is Status.PARTED for impact in mine)
    assert [*map(without_loop, mine)] == [*map(without_loop, theirs)]
