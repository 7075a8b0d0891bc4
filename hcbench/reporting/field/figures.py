"""Figures of the field page: a panel an engine."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.lines import Line2D

from hcbench.laws import closed_form
from hcbench.laws.force import HuntCrossley
from hcbench.reporting.field.view import PLUGIN
from hcbench.reporting.page import Drawing
from hcbench.reporting.plot_style import (
    KIND_COLOURS,
    LAW,
    draw_loop,
    legend_below,
    log_axis,
    new_figure,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from hcbench.reporting.field.view import Case, FieldView

# Panels side by side, at most.
_COLUMNS = 4
# Limits of the errors in figures: smaller and larger ones are drawn there.
_FLOOR = 1e-8
_CEILING = 30.0
_STOCK: dict[str, Any] = {"color": KIND_COLOURS["stock"], "marker": "X", "markersize": 5.0}
_BEST: dict[str, Any] = {"color": KIND_COLOURS["settings"], "marker": "s", "markersize": 3.5}
_PLUGIN: dict[str, Any] = {"color": KIND_COLOURS["exact"], "marker": "v", "markersize": 4.0}
_HEAVY: dict[str, Any] = {"linestyle": (0, (4, 1.6)), "markerfacecolor": "white"}
_CONSTANT: dict[str, Any] = {
    "color": KIND_COLOURS["constant"],
    "linewidth": 1.0,
    "linestyle": (0, (5, 2)),
}
_LAW: dict[str, Any] = {"color": LAW, "linewidth": 6, "solid_capstyle": "butt", "zorder": 1}


def drawings(view: FieldView) -> list[Drawing]:
    """The figures of a page, by name."""
    missing = ""
    make_loops = partial(loops_figure, view)
    if not any(_with_loops(view)):
        missing = "no engine of this study resolves its contact"
    steps = "Error of e over the time step, a panel an engine."
    loops = "Force over penetration, a panel an engine."
    return [
        Drawing("field-steps", partial(steps_figure, view), steps),
        Drawing("field-loops", None if missing else make_loops, loops, missing),
    ]


def steps_figure(view: FieldView) -> Figure:
    """Largest error of e over the step: nothing set, best setting,
    plug-in; without gravity and with.
    """
    figure, panels = _panels(view, view.engines)
    kinds: list[tuple[Callable[[str, float, float], Case | None], dict[str, Any]]] = [
        (view.stock, _STOCK),
        (view.best, _BEST),
        (lambda engine, gravity, step: view.best(engine, gravity, step, PLUGIN), _PLUGIN),
    ]
    for engine, axes in panels:
        axes.plot(view.steps, [view.constant_error(step) for step in view.steps], **_CONSTANT)
        for pick, style in kinds:
            for gravity in view.gravities:
                steps = []
                errors = []
                for step in view.steps:
                    case = pick(engine, gravity, step)
                    if case is not None:
                        steps.append(step)
                        errors.append(view.off(case))
                line = {"linewidth": 1.3, **style}
                if gravity:
                    line |= _HEAVY
                axes.plot(steps, np.clip(errors, _FLOOR, _CEILING), **line)
        log_axis(axes, "x")
        log_axis(axes, "y")
        axes.set_xlim(min(view.steps) / 1.6, max(view.steps) * 1.6)
        axes.set_ylim(_FLOOR / 1.5, _CEILING)
    _label(panels, "time step, s", "error of e")
    legend = [
        Line2D([], [], label="nothing set", **_STOCK),
        Line2D([], [], label="best setting of its own", **_BEST),
        Line2D([], [], label="plug-in", **_PLUGIN),
    ]
    if any(view.gravities):
        legend.append(Line2D([], [], label="the same under gravity", **{**_BEST, **_HEAVY}))
    legend.append(Line2D([], [], label="best constant e", **_CONSTANT))
    legend_below(figure, legend)
    return figure


def loops_figure(view: FieldView) -> Figure:
    """Force over penetration of the finest step's best setting, the law's loop under it."""
    cases = dict(_with_loops(view))
    figure, panels = _panels(view, list(cases))
    study = view.study
    law = HuntCrossley(float(study["stiffness"]), view.alpha, float(study["exponent"]))
    loop = closed_form.loop(law, float(study["mass_kg"]), float(study["step_speed"]), 241)
    for engine, axes in panels:
        axes.plot(1e6 * loop.penetration, 1e-3 * loop.force, **_LAW)
        rows = view.loops[cases[engine]]
        x, force = (rows[name].to_numpy(dtype=float) for name in ("penetration_m", "force_n"))
        draw_loop(axes, 1e6 * x, 1e-3 * force, color=KIND_COLOURS["settings"], linewidth=1.2)
        axes.set_title(f"{view.title(engine)}\n{cases[engine].setting}", fontsize=8.5)
    _label(panels, "penetration, µm", "force, kN")
    return figure


def _with_loops(view: FieldView) -> Iterator[tuple[str, Case]]:
    """Each engine with its best setting at the finest step that has a loop; without those that
    have none.
    """
    for engine in view.engines:
        for step in view.steps:
            case = view.best(engine, view.gravities[0], step)
            if case is not None and case in view.loops and view.scores[case]["loops"]:
                yield engine, case
                break


def _panels(view: FieldView, engines: list[str]) -> tuple[Figure, list[tuple[str, Axes]]]:
    """A panel for each engine, titled."""
    columns = min(_COLUMNS, max(1, len(engines)))
    rows = math.ceil(len(engines) / columns)
    figure = new_figure(0.6 + 2.55 * columns, 0.8 + 2.2 * rows)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(engines) :]:
        axes.set_visible(False)
    for engine, axes in zip(engines, grid, strict=False):
        axes.set_title(view.title(engine), fontsize=9)
    return figure, list(zip(engines, grid, strict=False))


def _label(panels: list[tuple[str, Axes]], x: str, y: str) -> None:
    """Labels of the outer axes alone: y on the left, x on the lowest panel of each column."""
    columns = min(_COLUMNS, len(panels))
    for i, (_, axes) in enumerate(panels):
        if i % columns == 0:
            axes.set_ylabel(y)
        if i >= len(panels) - columns:
            axes.set_xlabel(x)
