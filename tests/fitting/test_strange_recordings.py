"""Tables and force records that are disturbed, coarse, of light balls, or of other laws.

`strange_recordings` and `strange_forces` draw them from a design, with the truth. A few are fitted
here; `make test-all` fits as many as the page has, and compares its table.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from long_searches import long_study
from measured_bounces import EXACT, G, synthesise, times_of
from strange_forces import forces, judged_force, strange_force
from strange_recordings import judged, strange, tables

import hcbench as hb
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import Heights
from hcbench.fitting.read import read_dataset
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.system.errors import UserError

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "data.md"


def heights_of(law: synthesise.Law, seed: int, noise: float = 2e-4, most: int = 10) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.asarray(synthesise.bounce_heights(law, 0.6, noise, 4e-3, rng, most))


@pytest.mark.parametrize("touch", [4, 8])
def test_a_touch_that_was_missed_is_left_open(touch: int) -> None:
    times = times_of(synthesise.hunt_crossley(0.2), 3, timing=1e-4, scatter=3e-3)
    found = fit([TouchTimes("t", EXACT, np.delete(times, touch))])
    assert found.alpha is not None and found.alpha.low <= 0.2 <= found.alpha.high
    (said,) = found.warnings
    assert (
        f"a touch between {times[touch - 1]:.4g} s and {times[touch + 1]:.4g} s is missing" in said
    )


def test_a_reading_that_is_not_a_touch_is_left_out() -> None:
    times = times_of(synthesise.hunt_crossley(0.2), 3, timing=1e-4, scatter=3e-3)
    for extra in (times[0] - 0.1, times[5] + 0.02):
        found = fit([TouchTimes("t", EXACT, np.sort(np.append(times, extra)))])
        assert found.alpha is not None and found.alpha.low <= 0.2 <= found.alpha.high
        assert f"the reading {extra:.4g} s is not a touch" in found.warnings[0]


def test_heights_may_be_missed_doubled_or_exchanged() -> None:
    heights = heights_of(synthesise.constant(0.8), 1)
    swapped = heights.copy()
    swapped[[3, 4]] = swapped[[4, 3]]
    for changed, said in (
        (np.delete(heights, 3), "is missing"),
        (np.insert(heights, 3, heights[3]), "is not a touch"),
        (swapped, "are exchanged"),
    ):
        found = fit([Heights("h", EXACT, changed)])
        assert found.law == "constant" and found.restitution is not None
        assert abs(found.restitution.value - 0.8) < 0.01
        assert said in found.warnings[0]


def test_an_undisturbed_table_is_read_as_it_stands() -> None:
    for seed in range(4):
        times = times_of(synthesise.hunt_crossley(0.3), seed)
        assert not fit([TouchTimes("t", EXACT, times)]).warnings


def test_late_heights_may_be_equal_by_rounding(tmp_path: Path) -> None:
    heights = np.append(heights_of(synthesise.hunt_crossley(0.1), 2).round(3), [0.021, 0.021])
    path = tmp_path / "h.csv"
    path.write_text("height [m]\n" + "".join(f"{h:.3f}\n" for h in heights))
    assert hb.fit(path).alpha is not None


def test_late_heights_may_rise_by_rounding_and_heights_that_climb_are_refused(
    tmp_path: Path,
) -> None:
    """Read to 1 cm, two of the last heights are a centimetre above the one before: its last digit."""
    read = [0.30, 0.15, 0.08, 0.04, 0.02, 0.03, 0.02, 0.03]
    path = tmp_path / "h.csv"
    path.write_text("height [m]\n" + "".join(f"{height:.2f}\n" for height in read))
    data = read_dataset(path, EXACT)
    assert isinstance(data, Heights)
    np.testing.assert_allclose(data.heights, read)
    path.write_text("height [m]\n" + "".join(f"{height:.4f}\n" for height in read))
    with pytest.raises(UserError, match="heights that fall"):
        read_dataset(path, EXACT)
    path.write_text("height [m]\n" + "".join(f"{0.3 * 1.2**k:.3f}\n" for k in range(6)))
    with pytest.raises(UserError, match="heights that fall"):
        read_dataset(path, EXACT)


def test_the_air_of_a_light_ball_is_not_given_as_alpha() -> None:
    """A table tennis ball of e = 0.9: the drag looks like α; told its mass and size, it is none."""

    def fly(launch: float) -> tuple[float, float]:
        return synthesise.flight_in_air(launch, 2.7e-3, 0.04, 0.47)

    rng = np.random.default_rng(0)
    times = [0.0]
    for _, _, aloft in synthesise.flights(synthesise.constant(0.9), 1.0, 3e-3, rng, fly):
        if len(times) == 14:
            break
        times.append(times[-1] + aloft)
    read = np.array(times) + 1e-4 * rng.standard_normal(14)
    found = fit([TouchTimes("t", EXACT, read)])
    assert found.law is None and "--mass and --diameter" in found.reservation
    assert found.restitution is not None
    assert found.restitution.low - 0.01 < 0.9 < found.restitution.high + 0.01
    given = MeasurementSetup(gravity=G, mass=Known(2.7e-3), diameter=Known(0.04))
    assert fit([TouchTimes("t", given, read)]).law == "constant"


def light_ball(law: synthesise.Law, noise: float) -> TouchTimes:
    """Times of a table tennis ball, to within `noise` s."""

    def fly(launch: float) -> tuple[float, float]:
        return synthesise.flight_in_air(launch, 2.7e-3, 0.04, 0.47)

    rng = np.random.default_rng(1)
    aloft = [one for _, _, one in islice(synthesise.flights(law, 3.0, 3e-3, rng, fly), 9)]
    times = np.cumsum([0.0, *aloft])
    return TouchTimes("t", EXACT, times + noise * rng.standard_normal(len(times)))


@pytest.mark.parametrize("alpha", [0.03, 0.1, 0.14])
@pytest.mark.parametrize("noise", [2e-4, 1e-3])
def test_the_interval_of_a_light_balls_alpha_reaches_to_what_the_air_leaves(
    alpha: float, noise: float
) -> None:
    found = fit([light_ball(synthesise.hunt_crossley(alpha), noise)])
    assert found.alpha is not None and found.alpha.low < alpha < found.alpha.value
    # Precise times contradict the law in a vacuum.
    if noise < 1e-3:
        assert found.law is None and "in the air of a light ball" in found.reservation


def test_the_air_rivals_a_large_alpha_too() -> None:
    """In a vacuum the interval would begin at 0.2110."""
    found = fit([light_ball(synthesise.hunt_crossley(0.21), 2e-4)])
    assert found.alpha is not None and found.alpha.low < 0.21 < found.alpha.value


@pytest.mark.parametrize("drop", [0.8, 1.3])
def test_the_air_of_a_balloon_is_not_given_as_alpha(drop: float) -> None:
    """A balloon has four times the drag of a table tennis ball of its weight; e = 0.8 without mass and
    size.
    """

    def fly(launch: float) -> tuple[float, float]:
        return synthesise.flight_in_air(launch, 12e-3, 0.15, 0.47)

    rng = np.random.default_rng(2)
    flights = synthesise.flights(synthesise.constant(0.8), drop, 3e-3, rng, fly)
    times = np.cumsum([0.0, *(aloft for _, _, aloft in islice(flights, 9))])
    found = fit([TouchTimes("t", EXACT, times + 2e-4 * rng.standard_normal(10))])
    assert found.law is None and "air of a light ball" in found.reservation
    assert found.restitution is not None
    assert found.restitution.low - 0.01 < 0.8 < found.restitution.high + 0.01


# (mass in kg, diameter in m): table tennis, foam, a balloon, a beach ball.
LIGHT_BALLS = ((2.7e-3, 0.04), (9e-3, 0.07), (12e-3, 0.15), (60e-3, 0.3))


@pytest.mark.parametrize("drop", [0.5, 1.5])
@pytest.mark.parametrize("ball", LIGHT_BALLS)
def test_a_right_drop_height_of_a_light_ball_is_believed_and_a_wrong_one_is_not(
    ball: tuple[float, float], drop: float
) -> None:
    """In a vacuum a balloon of e = 0.8 would have 1.0 at the first touch and 0.7 at the second."""
    mass, diameter = ball
    displaced = 1.204 * np.pi / 6 * diameter**3
    pull = G.value * (mass - displaced) / (mass + displaced / 2)
    # Square of the speed at which the drag carries the ball.
    square = 2 * (mass - displaced) * G.value / (1.204 * 0.47 * np.pi / 4 * diameter**2)
    first = float(np.sqrt(-square * np.expm1(-2 * pull * drop / square)))

    def fly(launch: float) -> tuple[float, float]:
        return synthesise.flight_in_air(launch, mass, diameter, 0.47)

    rng = np.random.default_rng(3)
    flights = synthesise.flights(synthesise.constant(0.8), drop, 2e-3, rng, fly, first)
    times = np.cumsum([0.0, *(aloft for _, _, aloft in islice(flights, 7))])
    given = MeasurementSetup(
        gravity=G, height=Known(drop, 1e-3), mass=Known(mass), diameter=Known(diameter)
    )
    found = fit([TouchTimes("t", given, times + 2e-4 * rng.standard_normal(len(times)))])
    assert found.restitution is not None
    assert found.restitution.low - 0.01 < 0.8 < found.restitution.high + 0.01
    wrong = replace(given, height=Known(drop / 4, 1e-3))
    with pytest.raises(UserError, match="height"):
        fit([TouchTimes("t", wrong, times)])


# Light balls of a constant e, filmed and read by height.
@pytest.mark.parametrize("seed", [1024, 1141])
def test_a_constant_restitution_spans_that_in_air(tmp_path: Path, seed: int) -> None:
    verdict = judged(strange(seed), tmp_path)
    assert verdict.outcome == "right" and verdict.held, verdict.note


def test_a_heavy_ball_keeps_its_law_without_its_mass() -> None:
    for alpha in (0.15, 0.4):
        found = fit([TouchTimes("t", EXACT, times_of(synthesise.hunt_crossley(alpha), 1))])
        assert found.law is not None and not found.reservation


def test_e_that_scatters_as_no_balls_does_gives_no_number() -> None:
    times = times_of(synthesise.constant(0.7), 1, scatter=0.3, most=12)
    found = fit([TouchTimes("t", EXACT, times)])
    assert found.law is None and found.restitution is None
    assert "from bounce to bounce" in found.doubts[0]


def test_a_drop_height_of_a_soft_ball_is_believed() -> None:
    """α = 2.1 s/m from 0.3 m: e is 0.13 at the first touch and 0.59 at the second."""
    setup = MeasurementSetup(gravity=G, height=Known(0.3, 1e-3))
    times = times_of(synthesise.hunt_crossley(2.1), 0, timing=5e-5, scatter=3e-3, most=6)
    found = fit([TouchTimes("t", setup, times)])
    assert found.alpha is not None and found.alpha.low <= 2.1 <= found.alpha.high
    high = MeasurementSetup(gravity=G, height=Known(1.5, 1e-3))
    with pytest.raises(UserError, match="height"):
        fit([TouchTimes("t", high, times_of(synthesise.hunt_crossley(0.1), 0))])


# Seeds of the design: each has failed once.
@pytest.mark.parametrize("seed", [0, 23, 170, 216, 295, 360, 446, 536])
def test_a_disturbed_table_is_answered_or_left_open(tmp_path: Path, seed: int) -> None:
    one = strange(seed)
    verdict = judged(one, tmp_path)
    assert verdict.outcome not in ("wrong", "miss", "crash"), f"{one.what}: {verdict.note}"
    if one.fair and one.truth.law != "plastic":
        assert verdict.outcome in ("right", "undecided", "wide"), f"{one.what}: {verdict.note}"


def test_every_law_comes_near_a_film(tmp_path: Path) -> None:
    """The ln of evidence of laws differ by little where the film is a knocked ball's.

    Fits that began with other flights than the film's ended hundreds below.
    """
    path = tmp_path / "film.csv"
    path.write_text(strange(219).text)
    evidence = [one.log_evidence for one in hb.fit(path).fits]
    assert max(evidence) - min(evidence) < 100.0


# A pulse in 5 % of noise; one that starts with a jump; loops of friction and of the law.
@pytest.mark.parametrize("seed", [1, 2, 14, 146])
def test_a_strange_force_is_told_by_its_contact(tmp_path: Path, seed: int) -> None:
    outcome, note = judged_force(strange_force(seed), tmp_path)
    assert outcome in ("right", "wide"), note


OUTCOMES = ("right", "undecided", "wide", "silent", "miss", "wrong")


def published(row: str) -> dict[str, int]:
    """Numbers in a row of the page's table, by outcome; "silent" has refused ones too."""
    text = PAGE.read_text(encoding="utf-8")
    (line,) = (line for line in text.splitlines() if line.startswith(f"| {row} |"))
    return dict(zip(OUTCOMES, map(int, line.strip("| ").split(" | ")[1:]), strict=True))


def is_as_published(row: str, outcomes: list[str]) -> None:
    """Assert that outcomes are those of a row, but for a few at the edge of two on other machines."""
    count = Counter(outcomes)
    count["silent"] += count.pop("refused", 0)
    assert count["crash"] == 0
    for outcome, said in published(row).items():
        assert abs(count[outcome] - said) <= 3, outcome


@long_study
def test_the_pages_table_of_disturbed_tables_holds(tmp_path: Path) -> None:
    """Tables 1000 to 1399 of the design."""
    verdicts = [judged(one, tmp_path) for one in tables(400, 1000)]
    is_as_published("tables", [verdict.outcome for verdict in verdicts])
    held = [verdict.held for verdict in verdicts if verdict.held is not None]
    assert abs(len(held) - 267) <= 3 and sum(held) >= 249
    assert "in 252 of 267 tables" in " ".join(PAGE.read_text(encoding="utf-8").split())


@long_study
def test_the_pages_row_of_forces_holds(tmp_path: Path) -> None:
    """Records 1000 to 1149 of the design."""
    is_as_published("forces", [judged_force(one, tmp_path)[0] for one in forces(150, 1000)])
