"""Stiffness and damping of Adams and Newton, each against a second route to the same impact."""

from __future__ import annotations

import math
from typing import Any

import pytest
from scipy.integrate import solve_ivp

from hcbench import cli
from hcbench.laws import closed_form
from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.conventions import AdamsImpact, NewtonSpring
from hcbench.sim.convert import convert
from hcbench.system.errors import UserError
from hcbench.tuning.ask import make_target

STEEL = AdamsImpact(1e8, 1.5, 1e3, 1e-4)
SPEEDS = [0.05, 0.2, 1.0, 3.0]


def energy_balance(law: AdamsImpact, mass: float, speed: float) -> float:
    """e by dT/dx = -F(x, ±√(2T/m)); about the turning point, where T is 0, by dx/dv = -m v/F."""

    def by_depth(
        sign: float, x: tuple[float, float], energy: float, stop: float
    ) -> tuple[float, float]:
        def rate(at: float, t: Any) -> float:
            return -float(law.force(max(at, 0.0), sign * math.sqrt(2.0 * max(t[0], 0.0) / mass)))

        def reached(at: float, t: Any) -> float:
            return float(t[0] - stop)

        reached.terminal = True  # type: ignore[attr-defined]
        events: Any = reached if stop else None
        path = solve_ivp(rate, x, [energy], rtol=1e-10, atol=1e-14 * energy, events=events)
        return float(path.t[-1]), float(path.y[0, -1])

    first = 0.5 * mass * speed**2
    depth, energy = by_depth(1.0, (0.0, 1.0), first, 0.5 * first)
    v = math.sqrt(2.0 * energy / mass)
    slow = 1e-3 * v
    path = solve_ivp(
        lambda v, x: -mass * v / float(law.force(x[0], v)),
        (v, -slow),
        [depth],
        rtol=1e-10,
        atol=1e-16,
    )
    _, left = by_depth(-1.0, (float(path.y[0, -1]), 0.0), 0.5 * mass * slow**2, 0.0)
    return math.sqrt(left / first)


@pytest.mark.parametrize("speed", SPEEDS)
@pytest.mark.parametrize(
    "law", [STEEL, AdamsImpact(1e5, 1.0, 30.0, 1e-3), AdamsImpact(1e9, 2.2, 2e3, 5e-4)]
)
def test_adams_loses_what_the_balance_of_energy_says(law: AdamsImpact, speed: float) -> None:
    assert law.restitution(1.0, speed) == pytest.approx(energy_balance(law, 1.0, speed), abs=1e-6)


def test_adams_without_depth_and_exponent_is_a_spring_and_a_damper_that_do_not_pull() -> None:
    zeta = 0.2
    law = AdamsImpact(1e5, 1.0, 2.0 * zeta * math.sqrt(1e5), 1e-9)
    assert law.restitution(1.0, 0.5) == pytest.approx(
        float(kv.restitution(zeta, kv.Ending.FORCE)), abs=1e-5
    )


def test_adams_without_damping_keeps_all_and_a_deep_ramp_loses_more_when_fast() -> None:
    assert AdamsImpact(1e8, 1.5, 0.0, 1e-4).restitution(2.0, 0.3) == pytest.approx(1.0, abs=1e-8)
    of = [AdamsImpact(1e8, 1.5, 1e3, 1e-2).restitution(1.0, v) for v in SPEEDS]
    assert sorted(of, reverse=True) == of


def test_restitution_depends_on_mass_in_adams_and_by_newtons_springs_but_not_in_its_mujoco() -> (
    None
):
    assert STEEL.restitution(2.0, 0.2) > STEEL.restitution(1.0, 0.2)
    semi, mujoco = NewtonSpring(False, 1e4, 20.0), NewtonSpring(True, 1e4, 20.0)
    assert semi.restitution(2.0) > semi.restitution(1.0)
    assert mujoco.restitution(2.0) == mujoco.restitution(1.0)


@pytest.mark.parametrize("zeta", [0.0, 0.1, 0.5, 0.99, 1.0, 1.5])
def test_newtons_semi_implicit_damper_acts_on_the_way_in_only(zeta: float) -> None:
    damping = 2.0 * zeta * 100.0

    def stopped(_: float, y: Any) -> float:
        return float(y[1])

    stopped.terminal = True  # type: ignore[attr-defined]
    rates = lambda _, y: [y[1], -1e4 * y[0] - damping * y[1]]  # noqa: E731
    path = solve_ivp(rates, (0.0, 1.0), [0.0, 1.0], events=stopped, rtol=1e-10, atol=1e-14)
    returned = 100.0 * float(path.y[0, -1])  # ω X, of 1 m/s
    assert NewtonSpring(False, 1e4, damping).restitution(1.0) == pytest.approx(returned, abs=1e-6)


def test_newtons_default_in_mujoco_is_critical_as_mujocos_is() -> None:
    assert NewtonSpring(True, 2500.0, 100.0).restitution(1.0) == pytest.approx(
        math.exp(-2.0), abs=1e-9
    )


def test_convert_and_tune_take_them() -> None:
    found = convert(adams=STEEL, mass=1.0, speed=0.2)
    assert found.restitution == pytest.approx(STEEL.restitution(1.0, 0.2), abs=1e-9)
    springs = NewtonSpring(True, 2500.0, 20.0)
    e = springs.restitution(1.0)
    back = convert(newton=springs, speed=1.0, contact_time=1e-2)
    assert float(closed_form.restitution(back.alpha, 1.0)) == pytest.approx(e, abs=1e-9)
    (ke, kd) = next(row.value for row in back.rows if row.parameter == "ke, kd")
    assert NewtonSpring(True, ke, kd).restitution(1.0) == pytest.approx(e, abs=1e-9)
    _, target = make_target(timestep="1 ms", adams=STEEL, mass="1 kg", speeds="0.03:0.15 m/s")
    assert target.points[0] == pytest.approx((0.03, STEEL.restitution(1.0, 0.03)))
    _, target = make_target(timestep="1 ms", newton=springs)
    assert {e for _, e in target.points} == {springs.restitution(1.0)}


def test_the_command_reads_their_units(capsys: pytest.CaptureFixture[str]) -> None:
    texts = ["1e8 N/m^1.5, 1.5, 1 N s/mm, 0.1 mm", "1e8, 1.5, 1e3, 1e-4"]
    shown = []
    for text in texts:
        assert cli.run(["convert", "--adams", text, "--mass", "1 kg", "--speed", "0.2 m/s"]) == 0
        shown.append(capsys.readouterr().out.splitlines()[1])
    assert shown[0] == shown[1]


@pytest.mark.parametrize(
    "words",
    [
        ["--adams", "1e8, 1.5, 1e3", "--mass", "1", "--speed", "1"],
        ["--adams", "1e8, 1.5, 1e3, 1e-4", "--speed", "1"],
        ["--adams", "1e8, 0.5, 1e3, 1e-4", "--mass", "1", "--speed", "1"],
        ["--newton", "xpbd, 2500, 100", "--speed", "1"],
        ["--newton", "semi-implicit, 2500, 100", "--speed", "1"],
        ["--newton", "mujoco, 2500, 100", "--restitution", "0.5", "--speed", "1"],
    ],
)
def test_what_lacks_something_is_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.run(["convert", *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_adams_needs_a_mass() -> None:
    with pytest.raises(UserError, match="mass"):
        convert(adams=STEEL, speed=0.2)
