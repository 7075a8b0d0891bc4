"""The appendix and section 3.1: a mass in a gap, free and forced, its
events, its energy, its loops.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.special import gamma

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley, KelvinVoigt
from hcbench.laws.hertz_elliptic import contact, sphere
from hcbench.paper.vibroimpact.response import kelvin_voigt_blocks, linearized, orbits
from hcbench.paper.vibroimpact.simulate import simulate
from hcbench.paper.vibroimpact.system import SimulatedMotion, Sinusoid, VibroImpact, stored
from hcbench.system.errors import UserError
from hcbench.terms.scene import Material

K, MASS, ALPHA = 3.4064e10, 0.45359237, 0.3
LAW = HuntCrossley(K, ALPHA)
STEEL = Material(206.8e9, 0.3)


def _alike(gap: float, law: Any = LAW) -> VibroImpact:
    return VibroImpact(MASS, gap, law, law)


def _touches(run: SimulatedMotion, side: str) -> list[float]:
    return [e.time for e in run.events if e.side == side and e.kind == "touch"]


def _imbalance(run: SimulatedMotion) -> float:
    """The largest error of the energy balance, over all the energy that
    came in (at the start and by P).
    """
    total = run.kinetic + run.stored + run.lost - run.put_in
    came_in = abs(total[0]) + float(np.abs(np.diff(run.put_in)).sum())
    return float(np.abs(total - total[0]).max() / came_in) if came_in else 0.0


# --- free
# -------------------------------------------------------------------------------------------------------


def test_free_impacts_come_when_the_closed_forms_say_to_1e_12_s() -> None:
    gap, speed, until = 1e-3, 0.4, 0.03
    run = simulate(_alike(gap), 0.0, speed, until)
    time, wanted = 0.5 * gap / speed, []
    while time < until:
        wanted.append(time)
        time += float(closed_form.duration(LAW, MASS, speed))
        wanted.append(time)
        speed *= float(closed_form.restitution(ALPHA, speed))
        time += gap / speed
    got = np.array([e.time for e in run.events])
    assert len(got) > 12
    np.testing.assert_allclose(got, wanted[: len(got)], rtol=0.0, atol=1e-12)
    assert [e.kind for e in run.events[:4]] == ["touch", "part", "touch", "part"]
    assert [e.side for e in run.events[:4]] == ["right", "right", "left", "left"]
    assert _imbalance(run) < 1e-9


@pytest.mark.parametrize(("exponent", "stiffness"), [(1.0, 1e8), (1.5, K), (2.5, 1e15)])
@pytest.mark.parametrize("gap", [0.0, 3e-4])
def test_without_loss_the_period_is_the_closed_form_to_1e_10(
    exponent: float, stiffness: float, gap: float
) -> None:
    """T = 4 (x_m/v_i) √π Γ(1 + 1/(n+1)) / Γ(1/2 + 1/(n+1)), and 2 g/v_i for the flights."""
    law, speed, p = HuntCrossley(stiffness, 0.0, exponent), 0.4, 1.0 / (exponent + 1.0)
    depth = ((exponent + 1.0) * MASS * speed**2 / (2.0 * stiffness)) ** p
    period = (
        4.0 * depth / speed * math.sqrt(math.pi) * gamma(1.0 + p) / gamma(0.5 + p)
        + 2.0 * gap / speed
    )
    run = simulate(_alike(gap, law), 0.0, speed, 4.3 * period)
    touches = _touches(run, "left")
    assert len(touches) == 4
    np.testing.assert_allclose(np.diff(touches), period, rtol=1e-10)
    assert _imbalance(run) < 1e-9
    assert float(np.abs(run.lost).max()) < 1e-12 * run.kinetic[0]


def test_a_squeezed_mass_without_loss_swings_with_the_period_of_a_quadrature() -> None:
    law, squeeze, top = HuntCrossley(K, 0.0), 1e-5, 2.5e-5
    run = simulate(_alike(-2 * squeeze, law), top, 0.0, 2e-3)

    def energy(q: float) -> float:
        return stored(law, q + squeeze) + stored(law, squeeze - q)

    # q = top sin θ takes the root out of the turning point.
    def slice_of(theta: float) -> float:
        q = top * math.sin(theta)
        speed = math.sqrt(2.0 * (energy(top) - energy(q)) / MASS)
        return top * math.cos(theta) / speed

    pieces = [0.0, math.asin(squeeze / top), math.pi / 2 - 1e-9]
    quarter = sum(
        quad(slice_of, a, b, epsabs=0, epsrel=1e-12)[0] for a, b in itertools.pairwise(pieces)
    )
    touches = _touches(run, "right")
    assert len(touches) >= 4
    np.testing.assert_allclose(np.diff(touches), 4.0 * quarter, rtol=1e-8)
    assert _imbalance(run) < 1e-9


def test_a_free_mass_loses_energy_only_in_contact_and_never_is_pulled() -> None:
    run = simulate(_alike(-1e-5), 0.0, 0.3, 0.01)
    assert np.all(np.diff(run.lost) >= -1e-15 * run.kinetic[0])
    assert run.right.min() >= 0.0
    assert run.left.min() >= 0.0
    assert _imbalance(run) < 1e-9


# --- forced
# -----------------------------------------------------------------------------------------------------


def test_a_forced_piecewise_linear_mass_meets_its_exact_events_to_1e_12_s() -> None:
    """n = 1 without loss has closed forms between events; their roots by 30-digit arithmetic."""
    k, gap, force, f = 1e6, 2e-4, 60.0, 90.0
    run = simulate(_alike(gap, HuntCrossley(k, 0.0, 1.0)), 0.0, 0.05, 0.03, Sinusoid(force, f, 0.4))
    assert len(run.events) >= 10
    with mpmath.workdps(30):
        m, w = mpmath.mpf(MASS), 2 * mpmath.pi * mpmath.mpf(f)
        w0, half, phase = mpmath.sqrt(k / m), mpmath.mpf(gap) / 2, mpmath.mpf(0.4)
        t0, q, v = mpmath.mpf(0), mpmath.mpf(0), mpmath.mpf("0.05")
        centre: Any = None  # of the spring in contact
        for event in run.events:

            def motion(
                t: Any, order: int, t0: Any = t0, q: Any = q, v: Any = v, centre: Any = centre
            ) -> Any:
                if centre is None:
                    a = force / m
                    if order:
                        return v + a / w * (mpmath.cos(w * t0 + phase) - mpmath.cos(w * t + phase))
                    drift = (v + a / w * mpmath.cos(w * t0 + phase)) * (t - t0)
                    return (
                        q
                        + drift
                        - a / w**2 * (mpmath.sin(w * t + phase) - mpmath.sin(w * t0 + phase))
                    )
                b = force / (m * (w0**2 - w**2))
                c = q - centre - b * mpmath.sin(w * t0 + phase)
                s = (v - b * w * mpmath.cos(w * t0 + phase)) / w0
                x = w0 * (t - t0)
                if order:
                    swing = w0 * (s * mpmath.cos(x) - c * mpmath.sin(x))
                    return swing + b * w * mpmath.cos(w * t + phase)
                return (
                    centre + c * mpmath.cos(x) + s * mpmath.sin(x) + b * mpmath.sin(w * t + phase)
                )

            wall = half if event.side == "right" else -half
            root = mpmath.findroot(
                lambda t, motion=motion, wall=wall: motion(t, 0) - wall, event.time
            )
            assert abs(float(root) - event.time) < 1e-12
            assert event.kind == ("touch" if centre is None else "part")
            t0, q, v = root, wall, motion(root, 1)
            centre = wall if event.kind == "touch" else None
    assert _imbalance(run) < 1e-9


@pytest.mark.parametrize("gap", [2e-4, 0.0, -2e-5])
def test_forced_runs_close_their_energy_and_agree_with_another_integrator(gap: float) -> None:
    drive = Sinusoid(200.0, 400.0)
    run = simulate(_alike(gap), 0.0, 0.02, 6e-3, drive)
    assert _imbalance(run) < 1e-9
    assert run.put_in[-1] != 0.0
    half = gap / 2

    def rate(t: float, y: np.ndarray) -> list[float]:
        right, left = max(y[0] - half, 0.0), max(-y[0] - half, 0.0)
        force = (
            drive(t)
            - K * right**1.5 * (1 + 1.5 * ALPHA * y[1])
            + K * left**1.5 * (1 - 1.5 * ALPHA * y[1])
        )
        return [y[1], force / MASS]

    other: Any = solve_ivp(
        rate, (0, 6e-3), [0, 0.02], "DOP853", rtol=1e-12, atol=1e-17, max_step=2e-6
    )
    assert run.position[-1] == pytest.approx(other.y[0, -1], abs=1e-9 * np.abs(other.y[0]).max())
    assert run.velocity[-1] == pytest.approx(other.y[1, -1], abs=1e-9 * np.abs(other.y[1]).max())


def test_event_times_do_not_move_with_the_tolerance_by_more_than_1e_12_s() -> None:
    drive = Sinusoid(100.0, 200.0)
    runs = [simulate(_alike(2e-4), 0.0, 0.1, 0.02, drive, tolerance=t) for t in (1e-12, 1e-14)]
    first, second = (np.array([e.time for e in run.events]) for run in runs)
    assert len(first) > 15
    np.testing.assert_allclose(first, second, rtol=0.0, atol=1e-12)


def test_any_smooth_function_can_drive() -> None:
    wave = Sinusoid(100.0, 200.0)
    one = simulate(_alike(2e-4), 0.0, 0.1, 0.01, wave)
    other = simulate(_alike(2e-4), 0.0, 0.1, 0.01, wave.__call__, step_max=5e-4)
    times = [np.array([e.time for e in run.events]) for run in (one, other)]
    np.testing.assert_allclose(times[0], times[1], rtol=0.0, atol=1e-11)


def test_a_law_is_cut_off_where_it_would_pull_and_the_ledger_still_closes() -> None:
    soft = KelvinVoigt(1e8, 600.0)
    run = simulate(_alike(1e-3, soft), 0.0, 0.3, 0.02)
    assert [e.kind for e in run.events[:3]] == ["touch", "release", "part"]
    assert min(run.right.min(), run.left.min()) >= 0.0
    assert _imbalance(run) < 1e-9


def test_16_would_pull_too_when_drawn_out_of_a_block_faster_than_1_over_a() -> None:
    sticky = HuntCrossley(1e9, 20.0)
    run = simulate(_alike(-1e-4, sticky), 8e-5, 0.0, 2e-3, Sinusoid(-3e4, 300.0))
    release = next(e for e in run.events if e.kind == "release")
    assert release.rate == pytest.approx(-1.0 / sticky.dissipation, rel=1e-9)
    assert min(run.right.min(), run.left.min()) >= 0.0
    assert _imbalance(run) < 1e-9


def test_a_force_that_ended_comes_back_if_the_mass_is_pushed_in_again() -> None:
    thick = KelvinVoigt(1e6, 2000.0)
    run = simulate(_alike(-4e-4, thick), 0.0, 0.0, 0.02, Sinusoid(700.0, 150.0))
    kinds = [e.kind for e in run.events if e.side == "right"]
    assert {"release", "press"} <= set(kinds)
    assert min(run.right.min(), run.left.min()) >= 0.0
    assert _imbalance(run) < 1e-9


def test_a_grazing_touch_is_not_stepped_over() -> None:
    """A drive that brings the mass 1e-9 m into the block and out again,
    within one long step of flight.
    """
    force, f, reach = 20.0, 50.0, 1e-9
    swing = force / (MASS * (2 * math.pi * f) ** 2)  # q = -swing sin(ω t) with the speed below
    system = _alike(2 * (swing - reach))
    run = simulate(system, 0.0, -swing * 2 * math.pi * f, 0.019, Sinusoid(force, f))
    assert [e.side for e in run.events] == ["left", "left", "right", "right"]


# --- loops
# ------------------------------------------------------------------------------------------------------


def _cycle(run: SimulatedMotion, frequency: float) -> SimulatedMotion:
    return run.during(run.time[-1] - 1.0 / frequency, run.time[-1])


def test_the_summed_loop_over_a_cycle_is_the_energy_lost_in_it() -> None:
    system, f = _alike(-4e-5), 4000.0
    run = _cycle(simulate(system, 0.0, 0.0, 3 / f, Sinusoid(6000.0, f), step_max=0.002 / f), f)
    area = float(np.trapezoid(run.resultant, run.position))
    # Until the motion has settled the blocks also keep a part of what went in.
    kept = run.stored[-1] - run.stored[0]
    assert area == pytest.approx(float(run.lost[-1] - run.lost[0] + kept), rel=1e-4)
    assert run.events
    np.testing.assert_allclose(
        run.resultant, system.resultant(run.position, run.velocity), rtol=1e-12
    )


def _misfit(system: VibroImpact, amplitude: float, omega: float) -> float:
    """Distance of the loop of a harmonic swing from the best ellipse k q + c v, over its half width
    c v.
    """
    theta = np.linspace(0.0, 2.0 * math.pi, 4000, endpoint=False)
    q, v = amplitude * np.sin(theta), amplitude * omega * np.cos(theta)
    force = system.resultant(q, v)
    (k, c), *_ = np.linalg.lstsq(np.stack([q, v], axis=1), force, rcond=None)
    return float(np.sqrt(np.mean((force - k * q - c * v) ** 2)) / abs(c * amplitude * omega))


def test_small_swings_of_a_squeezed_mass_tend_to_the_ellipse_of_kelvin_and_voigt() -> None:
    squeeze, omega = 2e-5, 2 * math.pi * 500
    system = _alike(-2 * squeeze)
    shares = np.array([0.4, 0.2, 0.1, 0.05])
    misfits = np.array([_misfit(system, s * squeeze, omega) for s in shares])
    # The spring's own curvature goes with the cube of the swing, the
    # ellipse's width with its first power.
    np.testing.assert_allclose(np.log2(misfits[:-1] / misfits[1:]), 2.0, atol=0.1)
    linear = linearized(system)
    assert linear.stiffness == pytest.approx(2 * 1.5 * K * math.sqrt(squeeze), rel=1e-9)
    assert linear.damping == pytest.approx(2 * 1.5 * ALPHA * K * squeeze**1.5, rel=1e-9)
    tiny = 1e-4 * squeeze
    theta = np.linspace(0.0, 2.0 * math.pi, 400)
    force = system.resultant(tiny * np.sin(theta), tiny * omega * np.cos(theta))
    ellipse = tiny * (linear.stiffness * np.sin(theta) + linear.damping * omega * np.cos(theta))
    assert np.abs(force - ellipse).max() < 1e-8 * np.abs(ellipse).max()


def test_with_flat_contacts_the_loop_is_that_ellipse_exactly_until_a_side_is_lost() -> None:
    system = _alike(-2e-5, HuntCrossley(1e8, ALPHA, 1.0))
    assert _misfit(system, 0.999e-5, 5000.0) < 1e-12
    assert _misfit(system, 1.2e-5, 5000.0) > 1e-3


@pytest.mark.parametrize("exponent", [1.0, 1.25, 1.5, 2.0])
def test_the_linearized_mass_has_the_slopes_of_16(exponent: float) -> None:
    """k = 2 n k x0^(n-1) and c = 2 λ x0^n, with λ of eq. (15)."""
    law, x0 = HuntCrossley(K, ALPHA, exponent), 4e-6
    linear = linearized(_alike(-2 * x0, law))
    assert linear.stiffness == pytest.approx(2 * exponent * K * x0 ** (exponent - 1), rel=1e-10)
    assert linear.damping == pytest.approx(2 * 1.5 * ALPHA * K * x0**exponent, rel=1e-10)
    assert linear.mass == MASS


def test_between_unequal_blocks_the_mass_rests_nearer_to_the_softer_one() -> None:
    """Slopes in the middle made it three times too stiff."""
    stiff, soft = HuntCrossley(1e8, 0.1, 1.5), HuntCrossley(1e6, 0.1, 1.5)
    squeeze = 5e-5
    linear = linearized(VibroImpact(MASS, -2 * squeeze, stiff, soft))
    # k1 x1^1.5 = k2 x2^1.5, and x1 + x2 is the whole squeeze.
    ratio = 100.0 ** (2.0 / 3.0)
    deep = 2 * squeeze * ratio / (1.0 + ratio)
    shallow = 2 * squeeze - deep
    asked = 1.5 * 1e8 * math.sqrt(shallow) + 1.5 * 1e6 * math.sqrt(deep)
    assert linear.stiffness == pytest.approx(asked, rel=1e-9)


def test_a_small_forced_swing_is_the_linear_one() -> None:
    squeeze, f = 2e-5, 900.0
    system, linear = _alike(-2 * squeeze), linearized(_alike(-2 * squeeze))
    force = 1e-4 * squeeze * linear.stiffness
    # Start on the steady swing of the linear model: what is left of a transient is second order.
    w = 2 * math.pi * f
    reply = force / (linear.stiffness - MASS * w**2 + 1j * w * linear.damping)
    run = simulate(
        system, reply.imag, (1j * w * reply).imag, 10 / f, Sinusoid(force, f), step_max=0.01 / f
    )
    assert np.abs(run.position).max() == pytest.approx(abs(reply), rel=1e-3)
    assert abs(reply) == pytest.approx(float(linear.amplitude(force, f)), rel=1e-12)


# --- many at once
# -----------------------------------------------------------------------------------------------


def test_every_frequency_is_run_as_if_it_were_alone() -> None:
    system, drive = _alike(2e-4, HuntCrossley(K, 2.0)), Sinusoid(40.0, 100.0)
    values = np.array([80.0, 130.0])
    many = orbits(system, drive, "frequency", values, 4, 4, velocity=0.02, tolerance=1e-11)
    for i, f in enumerate(values):
        alone = simulate(system, 0.0, 0.02, 4 / f, Sinusoid(40.0, f))
        size = np.abs(alone.position).max()
        assert many.position[i, -1] == pytest.approx(alone.position[-1], abs=1e-6 * size)
        assert many.velocity[i, -1] == pytest.approx(
            alone.velocity[-1], abs=1e-6 * np.abs(alone.velocity).max()
        )
        # Steps end where the mass turns.
        assert many.highest[i].max() == pytest.approx(alone.position.max(), abs=1e-8 * size)
        assert many.lowest[i].min() == pytest.approx(alone.position.min(), abs=1e-8 * size)
        touched = sum(e.kind == "touch" for e in alone.events)
        assert many.touches[i].sum() == touched


def test_a_lane_has_the_same_bits_alone_and_in_a_batch() -> None:
    system, drive = _alike(1e-3, HuntCrossley(K, 0.6)), Sinusoid(100.0, 1.0)
    values = np.linspace(60.0, 120.0, 37)
    many = orbits(system, drive, "frequency", values, 4, 4)
    for i in (0, 17, 36):
        alone = orbits(system, drive, "frequency", values[i : i + 1], 4, 4)
        assert alone.velocity.tobytes() == many.velocity[i : i + 1].tobytes()
    shared = orbits(system, drive, "frequency", values, 4, 4, jobs=2)
    assert shared.velocity.tobytes() == many.velocity.tobytes()


def test_the_response_to_a_small_force_is_the_linear_one_at_every_frequency() -> None:
    system = _alike(-1e-5, HuntCrossley(K, 0.63))
    linear = linearized(system)
    f = np.linspace(0.86, 1.12, 56) * linear.resonance
    run = orbits(system, Sinusoid(4.0, 1.0), "frequency", f, 40, 2)
    np.testing.assert_allclose(run.amplitude, linear.amplitude(4.0, f), rtol=2e-3)


def test_over_the_gap_and_the_amplitude_too() -> None:
    drive = Sinusoid(40.0, 100.0)
    gaps = orbits(_alike(1e-4), drive, "gap", np.array([1e-4, 3e-4]), 3, 1)
    forces = orbits(_alike(1e-4), drive, "amplitude", np.array([40.0, 60.0]), 3, 1)
    assert gaps.position[0, 0] == pytest.approx(forces.position[0, 0], abs=1e-9)
    assert gaps.position[1, 0] != gaps.position[0, 0]


def test_a_settled_motion_is_seen_to_repeat() -> None:
    system = _alike(-4e-5, HuntCrossley(K, 3.0))
    settled = orbits(system, Sinusoid(50.0, 1.0), "frequency", np.array([2e3, 4e3]), 25, 8)
    apart = np.abs(np.diff(settled.position, axis=1)).max(axis=1)
    assert (apart <= 1e-4 * settled.amplitude).all()
    linear = linearized(system)
    np.testing.assert_allclose(settled.amplitude, linear.amplitude(50.0, settled.values), rtol=2e-3)
    assert settled.touches.max() == 0.0


def test_the_forced_response_departs_from_the_linear_one_when_impacts_set_in() -> None:
    """Section 3.1: "in some instances the response is significantly at variance"."""
    system = _alike(-4e-6, HuntCrossley(K, 10.0))
    linear = linearized(system)
    near = linear.resonance
    forces = np.array([1.0, 300.0])
    runs = orbits(system, Sinusoid(1.0, near), "amplitude", forces, 25, 6)
    share = runs.amplitude / np.array([float(linear.amplitude(f, near)) for f in forces])
    assert share[0] == pytest.approx(1.0, abs=2e-3)
    assert share[1] < 0.7
    assert runs.touches.max(axis=1).tolist() == [0.0, 2.0]


def test_the_piecewise_linear_stand_in_bounces_alike_at_its_own_speed_only() -> None:
    system = _alike(1e-3)
    stand_in = kelvin_voigt_blocks(system, 0.4)
    runs = [simulate(s, 0.0, 0.4, 0.025) for s in (system, stand_in)]
    first = [abs(next(e.rate for e in r.events if e.kind == "part")) for r in runs]
    assert first[0] == pytest.approx(first[1], rel=1e-9)
    later = [abs([e.rate for e in r.events if e.kind == "part"][5]) for r in runs]
    assert later[1] < 0.95 * later[0]  # (4) goes on losing the same share


# --- bad input
# --------------------------------------------------------------------------------------------------


def test_a_gap_so_negative_that_hertz_ends_is_refused_with_the_limit() -> None:
    pair = contact(sphere(0.0254, STEEL), sphere(-0.0508, STEEL))
    law = HuntCrossley(pair.stiffness, ALPHA)
    good = VibroImpact(MASS, -1.9 * pair.depth_max(), law, law, pair.depth_max())
    assert good.squeeze == pytest.approx(0.95 * pair.depth_max())
    assert pair.depth_max() == pytest.approx(
        0.005 * 0.0254, rel=1e-12
    )  # a = R1/10: a² = R x, R = 2 in
    with pytest.raises(
        UserError, match=r"gap: -0\.001 m squeezes .* at most 0\.000127 m.*Hertz's law ends"
    ):
        VibroImpact(MASS, -1e-3, law, law, pair.depth_max())


def test_a_drive_that_is_not_finite_is_named_with_its_time() -> None:
    with pytest.raises(UserError, match=r"drive: gave nan N at t = "):
        simulate(_alike(1e-4), 0.0, 0.1, 0.01, lambda t: math.nan if t > 5e-3 else 1.0)


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (math.nan, "nan N"),
        (math.inf, "inf N"),
        (1e300, "1e\\+300 N"),
        (None, "None"),
        ("1 N", "'1 N'"),
        (1j, "1j"),
    ],
)
def test_a_drive_that_gives_no_force_is_one_line(value: Any, named: str) -> None:
    with pytest.raises(
        UserError, match=f"drive: gave {named} at t = 0.0 s; expected a finite force"
    ):
        simulate(_alike(1e-4), 0.0, 0.1, 0.01, lambda _: value)


def test_what_a_drive_raises_is_reported_with_its_time() -> None:
    said = r"drive: raised ZeroDivisionError: .* at t = 0\.00\d+ s; expected a finite force"
    with pytest.raises(UserError, match=said) as caught:
        simulate(_alike(1e-4), 0.0, 0.1, 0.01, lambda t: 1.0 / float(t < 5e-3))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


def test_bad_numbers_are_named() -> None:
    with pytest.raises(UserError, match="mass: 0"):
        VibroImpact(0.0, 1e-3, LAW, LAW)
    with pytest.raises(UserError, match="gap: nan"):
        VibroImpact(MASS, math.nan, LAW, LAW)
    with pytest.raises(UserError, match="velocity: inf"):
        simulate(_alike(1e-3), 0.0, math.inf, 1.0)
    with pytest.raises(UserError, match="start: 0"):
        simulate(_alike(1e-3), 0.0, 0.0, 1.0)
    with pytest.raises(UserError, match="frequency: -1"):
        orbits(_alike(1e-3), Sinusoid(1.0, 1.0), "frequency", np.array([-1.0]), 1, 1)
    with pytest.raises(UserError, match="over: 'colour'; expected frequency or amplitude or gap"):
        orbits(_alike(1e-3), Sinusoid(1.0, 1.0), "colour", np.array([1.0]), 2, 1)  # type: ignore[arg-type]
    with pytest.raises(UserError, match="keep: 3"):
        orbits(_alike(1e-3), Sinusoid(1.0, 1.0), "frequency", np.array([1.0]), 2, 3)
    with pytest.raises(UserError, match="gap: 0"):
        linearized(_alike(0.0))
    with pytest.raises(UserError, match="law:"):
        kelvin_voigt_blocks(_alike(1e-3, KelvinVoigt(1e8, 600.0)), 0.4)
