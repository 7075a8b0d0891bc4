"""e of slow impacts under gravity with the restitution plug-in of MuJoCo:
docs/explanation/slow_impacts.svg.

    python benchmarks/slow_impacts.py

A ball falls on a plate at 2 ms, with 200 random starts of the step for each impact speed. e is of
the speeds at the touch plane; 0 where the ball stays down.
"""

from pathlib import Path

import matplotlib as mpl
import mujoco
import numpy as np
from matplotlib import pyplot as plt

from hcbench.contact import mujoco as contact
from hcbench.laws import closed_form

H, G, ALPHA, RADIUS, STARTS = 2e-3, 9.81, 0.315, 0.05, 200
MODEL = f"""<mujoco><option timestep="{H}"/><extension><plugin plugin="hcbench.restitution">
<instance name="i">
<config key="body1" value="ball"/><config key="body2" value="world"/><config key="alpha" value="{ALPHA}"/>
</instance></plugin></extension><worldbody><geom type="plane" size="1 1 1"/><body name="ball"><freejoint/>
<geom size="{RADIUS}" mass="1" condim="1"/></body></worldbody></mujoco>"""


def bounced(model: mujoco.MjModel, speed: float, rng: np.random.Generator) -> float:
    """e of one impact that reaches the touch plane at `speed`, m/s."""
    data, start = mujoco.MjData(model), rng.uniform()
    down = speed - G * H * (2 + start)  # some steps before touch: below 0 thrown upward
    height = (speed**2 - down**2) / (2 * G)
    data.qpos[2], data.qvel[2] = RADIUS + height, -(down - G * H / 2)
    highest, touched = 0.0, False
    for _ in range(60):
        mujoco.mj_step(model, data)
        touched |= data.qpos[2] <= RADIUS
        v = data.qvel[2] - G * H / 2  # what flight keeps, with 2 g z: the speed at the touch plane
        square = v * v + 2 * G * (data.qpos[2] - RADIUS)
        if touched and v > 0 and data.qpos[2] > RADIUS:
            highest = max(highest, square)
    return float(np.sqrt(highest)) / speed


def main() -> None:
    contact.load()
    model = mujoco.MjModel.from_xml_string(MODEL)
    rng = np.random.default_rng(1)
    ratios = np.linspace(0.1, 3.0, 59)
    seen = np.array([[bounced(model, r * G * H, rng) for _ in range(STARTS)] for r in ratios])
    law = closed_form.restitution(ALPHA, ratios * G * H)
    mpl.rcParams["svg.hashsalt"] = "hcbench"
    figure, axes = plt.subplots(figsize=(6, 3.2), layout="constrained")
    axes.fill_between(
        ratios, seen.min(axis=1), seen.max(axis=1), alpha=0.3, label="all starts of a step"
    )
    axes.plot(ratios, seen.mean(axis=1), label="mean")
    axes.plot(ratios, law, "k--", label="the law")
    axes.axvline(1.6, color="grey", lw=0.8)
    axes.set(xlabel="impact speed / (g h)", ylabel="e", ylim=(0, 1.1))
    axes.legend()
    path = Path(__file__).parents[1] / "docs" / "explanation" / "slow_impacts.svg"
    figure.savefig(path, metadata={"Date": None})
    for r, row, e in zip(ratios, seen, law, strict=True):
        print(
            f"{r:.2f} g h: e {row.min():.3f} ... {row.max():.3f}, mean {row.mean():.3f}; the law {e:.4f}"
        )


if __name__ == "__main__":
    main()
