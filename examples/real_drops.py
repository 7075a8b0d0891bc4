"""69 real drops of four balls, timed by phyphox: copied from your clone, fitted and drawn.

The recordings have no licence, so hcbench does not ship them:

    git clone https://github.com/giiulia/LabI-Dynamics-Thermodynamics
    python real_drops.py LabI-Dynamics-Thermodynamics drops

writes the copies, `drops.csv` and `drops.svg` into the folder `drops`.
"""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

import hcbench as hb

DATA = Path("Coefficient_of_restitution/Method2/Data")


@dataclass(frozen=True)
class Ball:
    """Files of one ball, and its mass and diameter where rules of the game give them."""

    files: str
    mass: str | None = None
    diameter: str | None = None


BALLS = {
    "table tennis": Ball("pingpong_ball/*.xlsx", "2.7 g", "40 mm"),
    "golf": Ball("golf_ball/CR_method2.xlsx", "45.9 g", "42.7 mm"),
    "blue": Ball("blue_ball/*.xls"),
    "tennis": Ball("tennis_ball/*.xls", "57.7 g", "66 mm"),
}


def copies(clone: Path, folder: Path, ball: Ball) -> list[Path]:
    """Copies of a ball's files in a folder, which is made."""
    files = sorted((clone / DATA).glob(ball.files))
    if not files:
        raise SystemExit(f"{clone / DATA / ball.files}: no such files; expected a clone with them")
    target = folder / Path(ball.files).parent
    target.mkdir(parents=True, exist_ok=True)
    return [Path(shutil.copy(file, target)) for file in files]


def main() -> None:
    """Copy, fit and draw; a row, a band and a point an impact for each ball."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clone", type=Path)
    parser.add_argument("folder", type=Path)
    given = parser.parse_args()
    mpl.rcParams |= {"svg.hashsalt": "drops", "svg.fonttype": "none"}
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot(xlabel="impact speed, m/s", ylabel="restitution e", ylim=(0.66, 1))
    rows = []
    for name, ball in BALLS.items():
        files = copies(given.clone, given.folder, ball)
        found = hb.fit(*files, mass=ball.mass, diameter=ball.diameter)
        curve = found.to_frame()
        (line,) = axes.plot(curve.speed_m_per_s, curve.restitution, label=name)
        for drop in found.sets:
            axes.plot(*drop.pairs(), ".", color=line.get_color(), markersize=2, alpha=0.5)
        ends = (curve.restitution_low, curve.restitution_high)
        axes.fill_between(curve.speed_m_per_s, *ends, color=line.get_color(), alpha=0.25)
        row: dict[str, object] = {"ball": name, "drops": len(found.sets), "law": found.law}
        for key, value in (("alpha", found.alpha), ("e", found.restitution)):
            if value is not None:
                row |= {key: value.value, f"{key}_low": value.low, f"{key}_high": value.high}
        rows.append(row | {"from_m_per_s": found.speeds[0], "to_m_per_s": found.speeds[1]})
        print(rows[-1])
    axes.legend(loc="lower right", ncols=2)
    figure.savefig(given.folder / "drops.svg", metadata={"Date": None})
    pd.DataFrame(rows).to_csv(given.folder / "drops.csv", index=False, float_format="%.4g")


if __name__ == "__main__":
    main()
