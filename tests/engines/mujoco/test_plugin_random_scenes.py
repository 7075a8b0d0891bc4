"""Energy in random scenes under MuJoCo's restitution plug-in: six here, 1000 under `make test-plugins`."""

from __future__ import annotations

import os
from functools import partial

import numpy as np
from contact_scenes import Scene
from plugin_options import energy_won, random_scene

COUNT, SECONDS = (1000, 1.0) if "HCBENCH_PLUGINS" in os.environ else (6, 0.4)


def test_contact_wins_no_energy_in_random_scenes() -> None:
    """The largest gain is told as a share of the energy at the start."""
    won = np.zeros(COUNT)
    for seed in range(COUNT):
        scene, options = random_scene(seed)
        won[seed] = energy_won(partial(Scene, scene.spec, scene.law, scene.start), options, SECONDS)[1]
    print(
        f"{COUNT} scenes: median {np.median(won):.1e}, most {won.max():.1e}, above 1 %: {(won > 0.01).sum()}"
    )
    assert np.median(won) < 1e-5
    assert won.max() < 0.01
