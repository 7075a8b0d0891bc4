"""Force over penetration: Fig. 4 of the paper redrawn, with each setting's loops over the law's."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from hcbench.impact import Floats
from hcbench.reporting import wording
from hcbench.reporting.plot_style import GREY, INK, LAW, SLATE, draw_loop, new_figure, second_axis
from hcbench.reporting.view import RunKey, View
from hcbench.units import INCH, POUND_FORCE

LOOP_SAMPLES = 8  # from which a loop has a shape to look at
_SAME_SCALE = 2.0  # within this factor of the law's penetration and force a loop shares the law's frame
_MARKED = 58  # samples below which each has a marker


def drawable(view: View) -> list[RunKey]:
    """Runs with enough samples in every loop: each setting at its finest step and at its coarse one."""
    enough = [run for run in view.loops if not run.is_law and _fewest_samples(view, run) >= LOOP_SAMPLES]
    finest = {run[:2]: min(o.timestep for o in enough if o[:2] == run[:2]) for run in enough}
    coarse = view.runs_by_resolution(resolved=False)
    return [run for run in enough if run.timestep == finest[run[:2]] or run in coarse]


def _fewest_samples(view: View, run: RunKey) -> int:
    """In any contact at the main α, before loops were thinned."""
    score = view.score(run)
    return 0 if score is None else int(score["samples_min"])


def on_law_scale(view: View, run: RunKey) -> bool:
    """Is its largest loop near enough the law's in depth and in force to share one frame?"""
    speed = max(view.loops[run])
    return all(1 / _SAME_SCALE <= ratio <= _SAME_SCALE for ratio in _over_law(view, run, speed))


def _over_law(view: View, run: RunKey, speed: float) -> tuple[float, float]:
    """Depth and force of a loop over the law's."""
    loop, law = view.loops[run][speed], view.law_loop(speed)
    return (
        loop["penetration_m"].max() / law.penetration.max(),
        loop["force_n"].max() / law.force.max(),
    )


def loops_figure(view: View, runs: list[RunKey]) -> Figure:
    """Absolute loops, one panel a setting, the law's behind them."""
    law_loops = {v: view.law_loop(v) for v in sorted({v for run in runs for v in view.loops[run]})}
    figure, panels, columns = _panels(len(runs))
    loops = pd.concat([loop for run in runs for loop in view.loops[run].values()])
    deepest = 1e6 * max(loops["penetration_m"].max(), *(law.penetration.max() for law in law_loops.values()))
    hardest = max(loops["force_n"].max(), *(law.force.max() for law in law_loops.values()))
    pull = min(0.0, loops["force_n"].min())
    for number, (axes, run) in enumerate(zip(panels, runs, strict=True)):
        for law in reversed(law_loops.values()):
            _draw_law_loop(axes, law.penetration * 1e6, law.force)
        for speed in sorted(view.loops[run]):
            _draw_run_loop(axes, view, run, view.loops[run][speed], 1e-6, 1.0)
            if number == 0:
                law = law_loops[speed]
                _name_speed(axes, wording.speeds([speed], view.in_inches), law.penetration * 1e6, law.force)
        axes.set_xlim(-0.02 * deepest, 1.06 * deepest)
        axes.set_ylim(1.1 * pull - 0.02 * hardest, 1.06 * hardest)
        axes.set_title(f"{run.title}, {run.step}", color=view.plot_style(run).colour)
        if number < columns:
            second_axis(axes, "top", "penetration, 10⁻⁴ in", INCH * 1e-4 * 1e6)
        if number % columns == 0:
            axes.set_ylabel("contact force F, N")
        if number % columns == columns - 1 or number == len(runs) - 1:
            second_axis(axes, "right", "lbf", POUND_FORCE)
        if number >= len(runs) - columns:
            axes.set_xlabel("penetration x, µm")
    _legend(figure)
    return figure


def shapes_figure(view: View, runs: list[RunKey]) -> Figure:
    """Loops of settings on another scale than the law's: each over its own largest depth and force."""
    figure, panels, columns = _panels(len(runs))
    for number, (axes, run) in enumerate(zip(panels, runs, strict=True)):
        speed = min(view.loops[run], key=lambda v: abs(v - float(view.study["step_speed"])))
        loop, law = view.loops[run][speed], view.law_loop(speed)
        depth, force = loop["penetration_m"].max(), loop["force_n"].max()
        _draw_law_loop(axes, law.penetration / law.penetration.max(), law.force / law.force.max())
        _draw_run_loop(axes, view, run, loop, depth, force)
        axes.set_xlim(min(-0.04, 1.1 * loop["penetration_m"].min() / depth), 1.06)
        axes.set_ylim(min(-0.04, 1.1 * loop["force_n"].min() / force), 1.08)
        deeper, harder = _over_law(view, run, speed)
        axes.set_title(f"{run.title}, {run.step}", color=view.plot_style(run).colour, pad=20)
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


def panel_columns(count: int) -> int:
    """Panels a row: three, or two or four where three would leave one alone in the last row."""
    if count in (2, 4):
        return 2
    return 4 if count > 4 and count % 3 == 1 and count % 4 != 1 else min(count, 3)


def _panels(count: int) -> tuple[Figure, list[Axes], int]:
    """A figure, its panels, and how many of them are in a row."""
    columns = panel_columns(count)
    rows = -(-count // columns)
    width = 3.55 if columns < 4 else 2.85
    figure = new_figure(0.5 + width * max(columns, 2), 0.6 + 3.1 * rows)
    return figure, [figure.add_subplot(rows, columns, i + 1) for i in range(count)], columns


def _draw_law_loop(axes: Axes, x: Floats, force: Floats) -> None:
    axes.fill(x, force, facecolor=LAW, alpha=0.45, edgecolor="none", zorder=1)
    axes.plot(x, force, color=GREY, linewidth=0.8, zorder=2)


def _draw_run_loop(
    axes: Axes, view: View, run: RunKey, loop: pd.DataFrame, depth: float, force: float
) -> None:
    x, f = (loop[name].to_numpy(dtype=float) for name in ("penetration_m", "force_n"))
    style = view.plot_style(run)
    marker = style.marker if _fewest_samples(view, run) < _MARKED else ""
    line = {"color": style.colour, "linewidth": 1.3, "marker": marker, "markersize": 3.5, "zorder": 3}
    draw_loop(axes, x / depth, f / force, **line, markerfacecolor=style.fill)


def _name_speed(axes: Axes, speed: str, x: Floats, force: Floats) -> None:
    top = int(force.argmax())
    axes.annotate(
        speed,
        (x[top], force[top]),
        (-5, 1),
        textcoords="offset points",
        ha="right",
        fontsize=8.5,
        color=SLATE,
        zorder=4,
    )


def _legend(figure: Figure) -> None:
    law = Patch(facecolor=LAW, alpha=0.6, edgecolor=GREY)
    engine = Line2D([], [], color=INK, linewidth=1.5)
    names = ["the law", "the setting named above the panel"]
    figure.legend([law, engine], names, loc="outside lower center", ncols=2)
