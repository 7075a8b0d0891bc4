"""α from measured bounces: unbiased, with intervals that hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_bounces import EXACT, G, synthesise, times_of, trials, write

from hcbench.fitting import ask
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import DropHeights, Heights, SpeedPairs
from hcbench.fitting.read import read_datasets
from hcbench.fitting.setup import Known, MeasurementSetup


@pytest.mark.parametrize(("alpha", "rms"), [(0.05, 0.03), (0.2, 0.018), (1.0, 0.014)])
def test_times_give_alpha_and_an_interval_that_holds(alpha: float, rms: float) -> None:
    law = synthesise.hunt_crossley(alpha)
    error, held = trials(lambda seed: TouchTimes("t", EXACT, times_of(law, seed)), alpha)
    assert error < rms
    assert held >= 0.87


def test_timing_alone_leaves_next_to_no_error() -> None:
    law = synthesise.hunt_crossley(0.2)
    make = lambda seed: TouchTimes("t", EXACT, times_of(law, seed, timing=5e-5, scatter=0.0))  # noqa: E731
    error, held = trials(make, 0.2, 15)
    assert error < 5e-4
    assert held == 1.0


@pytest.mark.parametrize(("alpha", "rms"), [(0.05, 0.006), (0.3, 0.01), (1.0, 0.03)])
def test_heights_give_alpha(alpha: float, rms: float) -> None:
    law, setup = (
        synthesise.hunt_crossley(alpha),
        MeasurementSetup(gravity=G, height=Known(0.3, 1e-6)),
    )

    def make(seed: int) -> Heights:
        rng = np.random.default_rng(seed)
        return Heights("h", setup, synthesise.bounce_heights(law, 0.3, 1e-3, 0.0, rng))

    error, held = trials(make, alpha)
    assert error < 1.3 * rms
    assert held >= 0.87


@pytest.mark.parametrize("alpha", [0.05, 0.5])
@pytest.mark.parametrize("twice", [False, True])
def test_pairs_give_alpha(alpha: float, twice: bool) -> None:
    law = synthesise.hunt_crossley(alpha)

    def make(seed: int) -> SpeedPairs:
        rng = np.random.default_rng(seed)
        v = rng.uniform(0.1, 2.0, 20)
        e = np.array([law(s) for s in v]) * (1 + 0.005 * rng.standard_normal(20))
        read = v * (1 + 0.01 * rng.standard_normal(20))
        if twice:  # v_out has an error of its own
            e = e * v * (1 + 0.01 * rng.standard_normal(20)) / read
            return SpeedPairs("p", EXACT, read, e, 0.01 * read, 0.01 * e, twice=True)
        return SpeedPairs("p", EXACT, read, e, 0.01 * read, np.zeros(20))

    assert trials(make, alpha)[1] >= 0.87


def test_one_drop_height_more_narrows_the_interval() -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 1)
    without = fit([TouchTimes("t", EXACT, times)], "hunt-crossley")
    given = fit(
        [TouchTimes("t", MeasurementSetup(gravity=G, height=Known(0.3, 1e-3)), times)],
        "hunt-crossley",
    )
    assert without.alpha is not None and given.alpha is not None
    assert given.alpha.uncertainty < without.alpha.uncertainty


def test_alpha_goes_as_one_over_g_and_the_budget_says_so() -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 1)
    at = [
        fit([TouchTimes("t", MeasurementSetup(gravity=Known(g, 0.05)), times)], "hunt-crossley")
        for g in (9.80665, 9.9)
    ]
    assert at[0].alpha is not None and at[1].alpha is not None
    assert at[0].alpha.value / at[1].alpha.value == pytest.approx(9.9 / 9.80665, rel=1e-6)
    (row,) = (row for row in at[0].budget.rows if row.source == "gravity")
    assert row.share == pytest.approx(at[0].alpha.value * 0.05 / 9.80665, rel=0.02)


@pytest.mark.parametrize("reading", ["restitution", "rebound height [m]", "flight time [s]"])
def test_gravity_counts_in_the_budget_of_drop_heights(tmp_path: Path, reading: str) -> None:
    """The share is what a fit at another gravity changes: drops have speeds by gravity alone."""
    path = tmp_path / "drops.csv"
    drops = np.linspace(0.2, 1.6, 8)
    speeds = np.sqrt(2.0 * 9.80665 * drops)
    e = np.exp(np.random.default_rng(1).normal(0.0, 1e-3, 8)) * (1.0 - 0.03 * speeds)
    after = {"restitution": e, "rebound height [m]": e**2 * drops}
    after["flight time [s]"] = 2.0 * e * speeds / 9.80665
    rows = [f"{h:.6f},{x:.6f}" for h, x in zip(drops, after[reading], strict=True)]
    path.write_text(f"drop height [m],{reading}\n" + "\n".join(rows) + "\n")
    found = []
    for g in (9.80665, 9.81665):
        setup = MeasurementSetup(gravity=Known(g, 0.01))
        found.append(fit(read_datasets(path, setup), "hunt-crossley"))
    first, moved = (one.alpha for one in found)
    assert first is not None and moved is not None
    (row,) = (row for row in found[0].budget.rows if row.source == "gravity")
    assert row.share == pytest.approx(abs(moved.value - first.value), rel=0.05)


def test_an_uncertain_height_counts_less_in_air() -> None:
    """A ball near its final speed arrives no faster from higher up."""
    ball: Any = {"mass": Known(2.7e-3), "diameter": Known(0.04), "drag_coefficient": Known(0.47)}
    ballistics = MeasurementSetup(gravity=G, **ball).ballistics
    heights = np.array([0.5, 2.0, 8.0])
    _, uncertainty = DropHeights(heights, np.full(3, 0.01)).speeds(ballistics)
    above = [ballistics.dropped(height + 0.01)[0] for height in heights]
    below = [ballistics.dropped(height - 0.01)[0] for height in heights]
    assert uncertainty == pytest.approx(0.5 * np.subtract(above, below), rel=1e-3)


def test_drag_that_is_left_out_makes_a_table_tennis_ball_lossy() -> None:
    ball: Any = {"mass": Known(2.7e-3), "diameter": Known(0.04), "drag_coefficient": Known(0.47)}
    fall = lambda w: synthesise.flight_in_air(w, 2.7e-3, 0.04, 0.47)  # noqa: E731
    rng, times = np.random.default_rng(0), [0.0]
    speed = MeasurementSetup(gravity=G, **ball).ballistics.dropped(0.3)[0]
    for _, _, aloft in synthesise.flights(
        synthesise.hunt_crossley(0.1), 0.3, 0.0, rng, fall, speed
    ):
        times.append(times[-1] + aloft)
        if len(times) == 15:
            break
    in_a_vacuum = fit([TouchTimes("t", EXACT, np.array(times))], "hunt-crossley").alpha
    in_air = fit(
        [TouchTimes("t", MeasurementSetup(gravity=G, **ball), np.array(times))], "hunt-crossley"
    ).alpha
    assert in_a_vacuum is not None and in_air is not None
    assert in_air.value == pytest.approx(0.1, rel=1e-4)
    assert in_a_vacuum.value == pytest.approx(0.1055, rel=0.01)


def test_a_fit_shows_itself_in_a_notebook(tmp_path: Path) -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 1)
    path = write(tmp_path, "time [s]\n" + "\n".join(f"{t:.6f}" for t in times), "<b>.csv")
    found = ask.fit(path)
    assert found.alpha is not None
    shown = found._repr_html_()
    assert f"{found.alpha.value:.3f}" in shown and "&lt;b&gt;.csv" in shown and "<b>" not in shown
    (axes,) = found.plot().axes
    law, data = (np.asarray(line.get_xydata()) for line in axes.lines)
    assert len(data) == len(times) - 2
    assert np.interp(1.0, *law.T) == pytest.approx(synthesise.hunt_crossley(0.3)(1.0), abs=0.01)
