"""One contact in every library's words, checked against what those words do."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from hcbench.laws import closed_form
from hcbench.laws.conventions import Conversion, SystemValue
from hcbench.laws.published import Flores
from hcbench.sim.convert import convert
from hcbench.system.errors import UserError

ALPHA, SPEED = 0.315, 0.4064
E = float(closed_form.restitution(ALPHA, SPEED))


def _row(found: Conversion, system: str, parameter: str, nth: int = 0) -> SystemValue:
    return [r for r in found.rows if (r.system, r.parameter) == (system, parameter)][nth]


def _full(**more: Any) -> Conversion:
    return convert(
        **{"alpha": ALPHA, "speed": SPEED, "contact_time": 1e-3, "timestep": 1e-3, **more}
    )


def test_drake_and_simbody_differ_by_the_3_2_that_the_paper_writes_out() -> None:
    found = _full()
    assert _row(found, "Drake", "hunt_crossley_dissipation").value == (1.5 * ALPHA,)
    assert _row(found, "Simbody", "dissipation").value == (ALPHA,)
    assert any("Drake's d is 1.5 α" in caveat for caveat in found.caveats)


def test_every_way_in_gives_the_same_contact() -> None:
    found = _full()
    direct = _row(found, "MuJoCo", "solref", 1).value
    positive = _row(found, "MuJoCo", "solref", 2).value
    one_step = _row(found, "MuJoCo", "solref", 0).value
    ways: list[dict[str, Any]] = [
        {"drake": 1.5 * ALPHA},
        {"simbody": ALPHA},
        {"restitution": E, "speed": SPEED},
        {"restitution": 1.0 - ALPHA * SPEED, "speed": SPEED, "target": "linear"},
        {"solref": direct, "speed": SPEED},
        {"solref": positive, "speed": SPEED},
        {"solref": one_step, "speed": SPEED, "timestep": 1e-3},
    ]
    for way in ways:
        assert convert(**way).alpha == pytest.approx(ALPHA, rel=1e-10), way


@pytest.mark.parametrize("nth", [1, 2])
def test_mujoco_bounces_with_the_solref_that_convert_prints(nth: int) -> None:
    mujoco = pytest.importorskip("mujoco")
    solref = _row(_full(timestep=None), "MuJoCo", "solref", nth - 1).text
    assert _bounce(mujoco, solref, 1e-6) == pytest.approx(E, abs=2e-4)


def test_mujoco_bounces_in_one_step_with_the_solref_that_convert_prints() -> None:
    mujoco = pytest.importorskip("mujoco")
    assert _bounce(mujoco, _row(_full(), "MuJoCo", "solref").text, 1e-3) == pytest.approx(
        E, rel=1e-9
    )


def _bounce(mujoco: Any, solref: str, timestep: float) -> float:
    model = mujoco.MjModel.from_xml_string(f"""
    <mujoco><option timestep="{timestep}" gravity="0 0 0" cone="elliptic"/>
      <default><geom solref="{solref}" solimp=".9999 .9999 .001" condim="1"/></default>
      <worldbody><geom type="plane" size="1 1 1"/>
        <body pos="0 0 .1001"><joint type="slide" axis="0 0 1"/>
          <geom type="sphere" size=".1" mass="3"/></body>
      </worldbody></mujoco>""")
    data = mujoco.MjData(model)
    data.qvel[0] = -SPEED
    for _ in range(int(3e-3 / timestep) + 5):
        mujoco.mj_step(model, data)
    return float(data.qvel[0] / SPEED)


def test_what_flores_is_asked_for_delivers_the_law() -> None:
    asked = _row(_full(), "Chrono", "restitution (Flores)").value[0]
    assert float(Flores.delivered(asked)) == pytest.approx(E, rel=1e-14)


@pytest.mark.parametrize("e", [0.3, 0.5, 0.9])
def test_the_old_tsuji_damping_of_lammps_delivered_something_else(e: float) -> None:
    """The damped Hertz spring with the manual's polynomial, with and without its √2, by an ODE."""
    polynomial = [1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218]
    factor = float(np.polynomial.polynomial.polyval(e, polynomial))

    def delivered(a: float) -> float:
        def rate(t: float, y: np.ndarray) -> list[float]:
            x = max(y[0], 0.0)
            return [y[1], -(x**1.5) - a * x**0.25 * y[1]]

        def parted(t: float, y: np.ndarray) -> float:
            return float(y[0]) if t > 0.1 else 1.0

        parted.terminal, parted.direction = True, -1  # type: ignore[attr-defined]
        run: Any = solve_ivp(rate, (0, 30), [0, 1], "DOP853", rtol=1e-10, atol=1e-12, events=parted)
        return float(-run.y_events[0][0][1])

    note = _row(convert(restitution=e, speed=0.4), "LAMMPS", "damping tsuji").note
    stated = float(note.split("delivered ")[1].split()[0])
    assert stated == pytest.approx(delivered(factor), abs=1e-4)
    assert delivered(factor * np.sqrt(2.0)) == pytest.approx(e, abs=0.01)


def test_the_reading_decides_which_e_the_engines_get() -> None:
    assert _row(_full(), "PyBullet", "restitution").value == (E,)
    linear = _row(_full(target="linear"), "PyBullet", "restitution").value
    assert linear[0] == pytest.approx(1.0 - ALPHA * SPEED, rel=1e-15)


def test_what_has_no_conversion_has_a_reason() -> None:
    assert convert(alpha=ALPHA).missing == (
        "Restitutions and solref: they need the speed at which they should hold.",
    )
    assert "below what any has" in convert(alpha=5.0, speed=1.0, target="linear").missing[0]
    assert len(convert(alpha=ALPHA, speed=SPEED).missing) == 2
    undamped = convert(alpha=0.0, speed=SPEED, contact_time=1e-3)
    assert any("timeconst" in line for line in undamped.missing)
    assert _row(undamped, "PyBullet", "restitution").value == (1.0,)


def test_refsafe_is_warned_of() -> None:
    stiff = _full(contact_time=1.7e-4, timestep=5e-3)
    assert "refsafe" in _row(stiff, "MuJoCo", "solref", 2).note


def test_it_goes_into_json_with_units_in_the_keys() -> None:
    content = json.loads(json.dumps(_full().as_dict(), allow_nan=False))
    assert content["alpha_s_per_m"] == ALPHA
    assert content["rows"][0]["value"] == [ALPHA]


@pytest.mark.parametrize(
    ("way", "message"),
    [
        ({}, "got nothing; expected exactly one of alpha, drake"),
        ({"alpha": 1.0, "drake": 1.0}, "got alpha and drake"),
        ({"alpha": -1.0}, "alpha: -1"),
        ({"drake": np.inf}, "drake: inf"),
        ({"restitution": 0.5}, "speed: none"),
        ({"restitution": 1.2, "speed": 1.0}, "restitution: 1.2"),
        ({"restitution": 0.0, "speed": 1.0}, "0 < e <= 1"),
        ({"alpha": 1.0, "speed": 0.0}, "speed: 0"),
        ({"alpha": 1.0, "timestep": -1e-3}, "timestep: -0"),
        ({"alpha": 1.0, "target": "exact"}, "target: 'exact'"),
        ({"solref": (0.0, -1500.0), "speed": 1.0}, "timestep: none"),
        ({"solref": (0.0, -3000.0), "speed": 1.0, "timestep": 1e-3}, "e = D h - 1 is 2"),
        ({"solref": (0.02, -1.0), "speed": 1.0}, "timeconst dampratio"),
        ({"solref": (np.nan, 1.0), "speed": 1.0}, "solref: nan is not finite"),
    ],
)
def test_bad_requests_are_named(way: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError) as caught:
        convert(**way)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("asked", "delivered"), [(0.94, 0.9407), (0.8, 0.808), (0.5, 0.550), (0.3, 0.397)]
)
def test_chronos_smc_contact_gives_more_than_it_is_asked_for(
    asked: float, delivered: float
) -> None:
    """Chrono's own formula (ChContactSMC, Hertz), integrated with its clamp at F = 0."""
    k, m, v = 3e6, 0.5, 0.7
    beta = math.log(asked) / math.hypot(math.log(asked), math.pi)

    def force(x: float, rate: float) -> float:
        sn = 1.5 * k * math.sqrt(max(x, 0.0))  # 2 E* sqrt(R x), of which k x^(1/2) is two thirds
        return max(
            0.0, 2.0 / 3.0 * sn * x - 2.0 * math.sqrt(5.0 / 6.0) * beta * math.sqrt(sn * m) * rate
        )

    x, rate, h = 0.0, v, 2e-7
    while x >= 0.0:  # the midpoint rule
        middle = rate - 0.5 * h * force(x, rate) / m
        x, rate = x + h * middle, rate - h * force(x + 0.5 * h * rate, middle) / m
    assert -rate / v == pytest.approx(delivered, abs=6e-4)
    converted = convert(restitution=delivered, speed=v)
    row = _row(converted, "Chrono", "restitution (SMC)")
    assert row.value[0] == pytest.approx(asked, abs=2e-3)
    assert "NSC" in _row(converted, "Chrono", "restitution").note
