"""A preview of a study: enough of it to see what its page will be like, in a fraction of the time."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from hcbench.system.errors import StudyError

if TYPE_CHECKING:
    from hcbench.benchmark.study import Run, Study


def preview(study: Study) -> Study:
    """The main α alone, every fourth speed, every second height and step, half the phases.

    Without oblique launches, those off the axis, and launches over the band for fewer α than the study's:
    these are the settings that each take a search. A table of engines by step has every second step of the
    study, so that each has all engines. StudyError where nothing is left.
    """
    speeds = study.speeds[3::4]
    if len(speeds) < 2:
        speeds = study.speeds[:: max(1, len(study.speeds) - 1)]  # the ends
    phases = max(1, study.phases // 2)
    runs = tuple(_thinned(run, study, speeds) for run in study.runs if _is_shown(run, study))
    runs = tuple(run for run in runs if run.timesteps)
    if not runs:
        got = "every run is oblique, off the axis or without the main α"
        raise StudyError("quick", got, "a run that a preview can show", "Run it without --quick")
    left_out = (
        f"{len(speeds)} of {len(study.speeds)} speeds, {phases} of {study.phases} phases, 1 of "
        f"{len(study.alphas)} α, every second height and every second step, and {len(runs)} of "
        f"{len(study.runs)} runs: none launched obliquely, off the axis or for fewer α; no PNG files"
    )
    return replace(
        study,
        title=f"{study.title} (quick)",
        alphas=(study.main_alpha,),
        speeds=speeds,
        phases=phases,
        runs=runs,
        left_out=left_out,
    )


def _is_shown(run: Run, study: Study) -> bool:
    plain = study.main_alpha in run.alphas and not (run.is_oblique or run.scene.off_axis)
    return plain and (run.dropped or run.speeds != study.speeds or set(run.alphas) == set(study.alphas))


def _thinned(run: Run, study: Study, speeds: tuple[float, ...]) -> Run:
    run = replace(run, alphas=(study.main_alpha,))
    if run.dropped:
        return replace(run, speeds=(*run.speeds[:-2:2], run.speeds[-1]))  # its band stays
    over_band = run.speeds == study.speeds
    steps = run.timesteps[::2]
    if study.page == "field":
        shown = sorted({step for other in study.runs for step in other.timesteps})[1::2]
        steps = tuple(step for step in run.timesteps if step in shown)
    return replace(run, speeds=speeds if over_band else run.speeds, timesteps=steps)
