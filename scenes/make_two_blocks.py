"""Writes two-blocks/tuned.xml: scene.xml with MuJoCo's own contact tuned to eq. (16), by staggered pairs.

    python scenes/make_two_blocks.py

For the steel body of section 3.1 and α = 0.016 s/in, about 0.4 m/s. Other masses, gaps, laws and speeds:
`hcbench.engines.mujoco.two_blocks.mjcf`.
"""

from __future__ import annotations

from pathlib import Path

from hcbench.engines.mujoco.two_blocks import mjcf
from hcbench.paper.vibroimpact_figures import FULL, LAW, LOOSE, STAND_IN_SPEED
from hcbench.sim.two_blocks import NAME, TwoBlocks

HEAD = """<!-- scene.xml, contact tuned to eq. (16): pairs of the ball with either block whose springs start
     at staggered depths, and dampers with the law's own shape, for k = 3.1e7 lb/in^1.5, alpha = 0.016 s/in,
     1 lb, impacts of 0.02 to 0.6 m/s. Needs MuJoCo 3.11 or later. Written by scenes/make_two_blocks.py. -->
"""


def main() -> None:
    """Write the file."""
    blocks = TwoBlocks(LOOSE.mass, LOOSE.gap, LAW, FULL.timestep, STAND_IN_SPEED)
    (Path(__file__).parent / NAME / "tuned.xml").write_text(HEAD + mjcf(blocks), encoding="utf-8")


if __name__ == "__main__":
    main()
