"""Height over time, as films give it."""

from __future__ import annotations

import numpy as np
import pytest
from measured_bounces import EXACT, synthesise, trials

from hcbench.fitting.fit import fit
from hcbench.fitting.track import Track, track_of
from hcbench.system.errors import UserError


@pytest.mark.parametrize(("alpha", "frames"), [(0.1, 60), (0.4, 240), (1.0, 60)])
def test_a_track_gives_alpha(alpha: float, frames: float) -> None:
    law = synthesise.hunt_crossley(alpha)

    def make(seed: int) -> Track:
        rng = np.random.default_rng(seed)
        return track_of("film", EXACT, *synthesise.track(law, 0.5, 4e-3, 1e-3, frames, rng))

    error, held = trials(make, alpha, 20)
    assert error < 0.017
    assert held >= 0.8


def test_a_wrong_scale_of_a_film_is_told() -> None:
    times, heights = synthesise.track(
        synthesise.hunt_crossley(0.2), 0.5, 4e-3, 1e-3, 120, np.random.default_rng(1)
    )
    assert not fit([track_of("film", EXACT, times, heights)]).warnings
    (warning,) = fit([track_of("film", EXACT, times, 1.05 * heights)]).warnings
    assert "105." in warning and "scale" in warning


@pytest.mark.parametrize(
    ("slower", "larger"), [(1.5, 1.0), (8.0, 1.0), (0.5, 1.0), (1.0, 0.5), (1.0, 39.37)]
)
def test_a_film_at_another_rate_or_in_another_unit_is_refused(slower: float, larger: float) -> None:
    law = synthesise.hunt_crossley(0.2)
    times, heights = synthesise.track(law, 0.5, 4e-3, 1e-3, 240, np.random.default_rng(1))
    share = larger / slower**2
    with pytest.raises(UserError, match=rf"fall with {share:.2g}.* times the g given"):
        track_of("film", EXACT, slower * times, larger * heights)
