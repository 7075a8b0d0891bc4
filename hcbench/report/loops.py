"""Force over penetration: Fig. 4 of the paper redrawn, with each setting's loops over the law's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hcbench.laws import closed_form
from hcbench.report import style, wording
from hcbench.report.view import REFERENCE, TRUTH, Run, View

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.impact import Floats, Loop

DRAWABLE = 8  # samples from which a loop has a shape to look at
_SAME_SCALE = 2.0  # within this factor of the law's penetration and force a loop shares the law's frame
_LAW_POINTS = 241


def drawable(view: View) -> list[Run]:
    """Runs with enough samples in every loop: each setting at its finest step and at its coarse one."""
    enough = [
        run
        for run, loops in view.loops.items()
        if run[:2] != (REFERENCE, TRUTH) and min(map(len, loops.values())) >= DRAWABLE
    ]
    finest = {run[:2]: min(o.timestep for o in enough if o[:2] == run[:2]) for run in enough}
    coarse = view.of_class(fine=False)
    return [run for run in enough if run.timestep == finest[run[:2]] or run in coarse]


def law_loop(view: View, speed: float) -> Loop:
    """The law's loop for the main α."""
    return closed_form.loop(view.law(view.main_alpha), float(view.study["mass_kg"]), speed, _LAW_POINTS)


def on_law_scale(view: View, run: Run) -> bool:
    """Is its largest loop near enough the law's in depth and in force to share one frame?"""
    speed = max(view.loops[run])
    loop, truth = view.loops[run][speed], law_loop(view, speed)
    depth = loop["penetration_m"].max() / truth.penetration.max()
    force = loop["force_n"].max() / truth.force.max()
    return all(1 / _SAME_SCALE <= ratio <= _SAME_SCALE for ratio in (depth, force))


def loops_figure(view: View, runs: list[Run]) -> Figure:
    """Absolute loops, one panel a setting, the law's behind them."""
    speeds = sorted({speed for run in runs for speed in view.loops[run]})
    truths = {speed: law_loop(view, speed) for speed in speeds}
    figure, panels = _panels(len(runs))
    columns = _columns(len(runs))
    sizes = [_size(loop) for run in runs for loop in view.loops[run].values()]
    sizes += [(t.penetration.max(), t.force.max(), 0.0) for t in truths.values()]
    deepest, hardest = max(size[0] for size in sizes), max(size[1] for size in sizes)
    pull = min(0.0, *(size[2] for size in sizes))
    for number, (axes, run) in enumerate(zip(panels, runs, strict=True)):
        for truth in reversed(truths.values()):
            _draw_law_loop(axes, truth.penetration * 1e6, truth.force)
        for speed in sorted(view.loops[run]):
            _draw_loop(axes, view, run, view.loops[run][speed], 1e-6, 1.0)
            if number == 0:
                _name_speed(axes, truths[speed], speed)
        axes.set_xlim(-0.02 * deepest * 1e6, 1.06 * deepest * 1e6)
        axes.set_ylim(1.1 * pull - 0.02 * hardest, 1.06 * hardest)
        axes.set_title(_title(run), color=view.look(run).colour)
        first_row, first_column = number < columns, number % columns == 0
        if first_row:
            style.inch_axis(axes, "top", "penetration, 10⁻⁴ in", wording.INCH * 1e-4 * 1e6)
        if first_column:
            axes.set_ylabel("contact force F, N")
        if number % columns == columns - 1 or number == len(runs) - 1:
            style.inch_axis(axes, "right", "lbf", wording.POUND_FORCE)
        if number >= len(runs) - columns:
            axes.set_xlabel("penetration x, µm")
    _legend(figure)
    return figure


def _size(loop: pd.DataFrame) -> tuple[float, float, float]:
    """Depth, largest and least force."""
    force = loop["force_n"]
    return float(loop["penetration_m"].max()), float(force.max()), float(force.min())


def shapes_figure(view: View, runs: list[Run]) -> Figure:
    """Loops of settings on another scale than the law's: each over its own largest depth and force."""
    figure, panels = _panels(len(runs))
    columns = _columns(len(runs))
    for number, (axes, run) in enumerate(zip(panels, runs, strict=True)):
        speed = min(view.loops[run], key=lambda v: abs(v - float(view.study["step_speed"])))
        loop, truth = view.loops[run][speed], law_loop(view, speed)
        depth, force = loop["penetration_m"].max(), loop["force_n"].max()
        _draw_law_loop(axes, truth.penetration / truth.penetration.max(), truth.force / truth.force.max())
        _draw_loop(axes, view, run, loop, depth, force)
        axes.set_xlim(min(-0.04, 1.1 * loop["penetration_m"].min() / depth), 1.06)
        axes.set_ylim(min(-0.04, 1.1 * loop["force_n"].min() / force), 1.08)
        deeper, harder = depth / truth.penetration.max(), force / truth.force.max()
        axes.set_title(_title(run), color=view.look(run).colour, pad=20)
        axes.annotate(
            f"{wording.times(deeper)} the law's depth, {wording.times(harder)} its force",
            (0.5, 1.03),
            xycoords="axes fraction",
            ha="center",
            fontsize=8.5,
        )
        axes.set_xlabel("x over its largest")
        if number % columns == 0:
            axes.set_ylabel("F over its largest")
    _legend(figure)
    return figure


def _columns(count: int) -> int:
    """Panels a row: three, or two or four where three would leave one alone in the last row."""
    if count in (2, 4):
        return 2
    return 4 if count > 4 and count % 3 == 1 and count % 4 != 1 else min(count, 3)


def _panels(count: int) -> tuple[Figure, list[Axes]]:
    columns = _columns(count)
    rows = -(-count // columns)
    width = 3.55 if columns < 4 else 2.85
    figure = style.new_figure(0.5 + width * max(columns, 2), 0.6 + 3.1 * rows)
    grid = [figure.add_subplot(rows, columns, i + 1) for i in range(count)]
    return figure, grid


def _title(run: Run) -> str:
    return f"{wording.setting_name(run.engine, run.setting)}, {wording.time(run.timestep)}"


def _draw_law_loop(axes: Axes, x: Floats, force: Floats) -> None:
    axes.fill(x, force, facecolor=style.LAW, alpha=0.45, edgecolor="none", zorder=1)
    axes.plot(x, force, color="#8b949c", linewidth=0.8, zorder=2)


def _draw_loop(axes: Axes, view: View, run: Run, loop: pd.DataFrame, depth: float, force: float) -> None:
    """The engine's samples joined up, from the axis at touch and back to it at parting."""
    x = loop["penetration_m"].to_numpy(dtype=float) / depth
    f = loop["force_n"].to_numpy(dtype=float) / force
    x, f = np.concatenate([x[:1], x, x[-1:]]), np.concatenate([[0.0], f, [0.0]])
    few = len(x) < 60
    look = view.look(run)
    axes.plot(
        x,
        f,
        color=look.colour,
        linewidth=1.3,
        marker=look.marker if few else "",
        markersize=3.5,
        markerfacecolor="white" if look.hollow else look.colour,
        zorder=3,
    )


def _name_speed(axes: Axes, truth: Loop, speed: float) -> None:
    top = int(truth.force.argmax())
    axes.annotate(
        wording.inches_per_second(speed),
        (truth.penetration[top] * 1e6, truth.force[top]),
        (-5, 1),
        textcoords="offset points",
        ha="right",
        fontsize=8.5,
        color=style.LINEAR,
        zorder=4,
    )


def _legend(figure: Figure) -> None:
    law = Patch(facecolor=style.LAW, alpha=0.6, edgecolor="#8b949c")
    engine = Line2D([], [], color=style.INK, linewidth=1.5)
    names = ["the law, eq. (16)", "the setting named above the panel"]
    figure.legend([law, engine], names, loc="outside lower center", ncols=2)
