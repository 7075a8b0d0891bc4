"""Choice of the law that the data support, or of none."""

from __future__ import annotations

import math

import numpy as np
import pytest
from long_searches import LONG
from measured_bounces import EXACT, synthesise, times_of

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.fit import fit
from hcbench.fitting.heights import SpeedPairs
from hcbench.fitting.result import headline
from hcbench.fitting.which_law import EITHER, FAMILY
from hcbench.system.errors import UserError

# Drops of each kind; `make test-all` has all of them.
DROPS = 3 if LONG else 1
FAULTLESS = 8 if LONG else 3


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (synthesise.hunt_crossley(0.3), EITHER),
        (synthesise.constant(0.7), "constant"),
        (synthesise.viscoelastic(0.25), "viscoelastic"),
        (synthesise.plastic(0.8), "plastic"),
        (synthesise.hunt_crossley(0.3, e0=0.9), "hunt-crossley with e0"),
    ],
)
def test_the_law_is_told_from_good_data(law: synthesise.Law, name: str) -> None:
    for seed in range(DROPS):
        found = fit(
            [TouchTimes("t", EXACT, times_of(law, seed, timing=5e-5, scatter=2e-3, most=20))]
        )
        assert found.law == name or {found.law, name} == {EITHER, "hunt-crossley"}


def test_few_poor_touches_do_not_tell_the_law() -> None:
    left_open, widths = 0, []
    for seed in range(6):
        times = times_of(synthesise.hunt_crossley(0.3), seed, timing=1e-3, scatter=1e-2, most=6)
        found = fit([TouchTimes("t", EXACT, times)])
        left_open += found.law is None
        assert found.law in (None, *FAMILY)
        assert found.alpha is not None
        widths.append(found.alpha.uncertainty)
    assert np.median(widths) > 0.005
    assert left_open >= 4


def test_a_mistimed_touch_is_flagged_and_kept() -> None:
    times = times_of(synthesise.hunt_crossley(0.2), 2)
    assert not fit([TouchTimes("t", EXACT, times)], "hunt-crossley").flags
    times[5] += 4e-3
    (flag,) = fit([TouchTimes("t", EXACT, times)], "hunt-crossley").flags
    assert flag.touch.startswith("touch 6 ") and flag.what == "measured off"
    assert flag.size == pytest.approx(4e-3, rel=0.3)


def test_bounces_that_gain_energy_are_refused() -> None:
    with pytest.raises(UserError, match="gain energy"):
        fit([TouchTimes("t", EXACT, np.array([0.0, 0.1, 0.21, 0.33, 0.46, 0.6, 0.75]))])


@pytest.mark.parametrize(
    ("e", "what"),
    [
        (lambda v: math.sqrt(1 - (0.1 / v) ** 2) * synthesise.hunt_crossley(0.15)(v), "adhesion"),
        (lambda v: 0.9 * (1 - math.exp(-v / 0.3)), "low at low speeds"),
        (lambda v: 0.8 + 0.1 * math.log10(v), "rising"),
        (lambda v: v, "as large as the speed"),
    ],
)
def test_a_curve_of_none_of_the_laws_is_none(e: synthesise.Law, what: str) -> None:
    """Impacts at 0.15 to 2 m/s whose e falls at low speeds, where every law of the list rises."""
    for seed in range(DROPS):
        rng = np.random.default_rng(seed)
        v = np.geomspace(0.15, 0.95, 14) * (2.0 if what != "as large as the speed" else 1.0)
        noisy = np.array([e(x) for x in v]) * (1 + 3e-3 * rng.standard_normal(len(v)))
        found = fit([SpeedPairs("p", EXACT, v, noisy, np.zeros(14), np.zeros(14))])
        assert found.law is None and found.alpha is None
        assert found.lack.is_certain
        assert "none of these laws" in headline(found)["law"]


def test_adhesion_is_no_constant_loss() -> None:
    """No law whose α is wrong is chosen, even if the touches are too few to tell adhesion."""

    def sticky(v: float) -> float:
        return math.sqrt(max(1 - (0.1 / v) ** 2, 0.01)) * synthesise.hunt_crossley(0.15)(v)

    named = 0
    for seed, most in enumerate((7, 9, 11, 13, 15, 17, 19, 21)):
        found = fit([TouchTimes("t", EXACT, times_of(sticky, seed, drop=0.6, most=most))])
        named += found.lack.is_certain
        assert found.law != "hunt-crossley with e0"
        assert found.alpha is None or found.alpha.low <= 0.15 <= found.alpha.high
    assert named >= 3


@pytest.mark.parametrize("law", [synthesise.constant(0.7), synthesise.hunt_crossley(0.3, 0.97)])
def test_a_law_of_the_list_does_not_lack(law: synthesise.Law) -> None:
    for seed in range(FAULTLESS):
        assert not fit([TouchTimes("t", EXACT, times_of(law, seed))]).lack.is_certain


def test_impacts_of_a_cube_tell_no_law() -> None:
    """Hundreds of impacts whose e varies by a third, over little more than an octave of speeds."""
    rng = np.random.default_rng(5)
    v = rng.uniform(0.6, 1.45, 200)
    e = 0.24 * np.exp(0.25 * rng.standard_normal(200)) * np.where(rng.random(200) < 0.05, 0.3, 1.0)
    found = fit([SpeedPairs("tosses", EXACT, v, e, np.zeros(200), np.zeros(200))])
    assert found.law in (None, "constant")
    assert found.best.scatter == pytest.approx(float(e.std() / e.mean()), rel=0.2)
