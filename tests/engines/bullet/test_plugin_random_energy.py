"""Energy in random scenes under PyBullet's restitution plug-in: eight here, 300 under `make test-plugins`."""

from __future__ import annotations

import os
import re

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="no PyBullet for this Python")

from bullet_random import KINDS, energy_won

COUNT, SECONDS = (75, 1.0) if "HCBENCH_PLUGINS" in os.environ else (2, 0.4)


@pytest.mark.parametrize("kind", KINDS)
def test_contact_wins_no_energy_or_the_body_is_named(kind: str) -> None:
    """Up to where the plug-in says that a jointed body turns too far in a step."""
    seen = [energy_won(seed, kind, SECONDS) for seed in range(COUNT)]
    won, named = np.array([one[0] for one in seen]), [one[1] for one in seen if one[1]]
    print(f"{kind}: {COUNT} scenes, median {np.median(won):.1e}, most {won.max():.1e}, named {len(named)}")
    assert won.max() < 0.01
    assert all("too far for Bullet's joints" in one for one in named)
    assert kind == KINDS[3] or not named


def test_a_jointed_body_that_turns_too_far_in_a_step_is_named_with_a_step_to_take() -> None:
    said = next(said for seed in range(20) if (said := energy_won(seed, KINDS[3], 0.4)[1]))
    assert re.fullmatch(
        r"restitution, law \d+: body \d+ turns by 0\.\d+ rad in a step of [\d.]+ s, too far for"
        r" Bullet's joints: take [\d.e-]+ s",
        said,
    )
