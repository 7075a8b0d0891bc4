"""The page's first screen in words: which setting to take for an engine, a step, a gravity and an α."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hcbench.reporting import wording
from hcbench.reporting.ranking import STOCK, TIE, grade, lacks, over_constant
from hcbench.reporting.view import REFERENCE, RunKey, View

_WARNED = 2  # settings that an answer warns about


@dataclass(frozen=True, slots=True)
class PageAnswer:
    """What to do, for one engine, step, gravity and α.

    say: one sentence with its number. more: what is named in it, what to do without a plug-in, what not to
    use. best: the setting to take; None where none is good enough.
    shown: the runs to draw, the best and stock.
    """

    say: str
    more: Sequence[str]
    best: RunKey | None
    shown: Sequence[RunKey]


def answer(view: View, with_gravity: View | None, engine: str, step: float, alpha: float) -> PageAnswer:
    """The answer for the settings that ran so. with_gravity: the same under gravity, for what lacks there."""
    runs = [run for run in view.band_runs if run.engine == engine and run.timestep == step]
    runs = [run for run in runs if view.score(run, alpha) is not None]
    stock = next((run for run in runs if run.setting == STOCK), None)
    choice = sorted((run for run in runs if run != stock), key=lambda run: _error(view, run, alpha))
    usable = [run for run in choice if math.isfinite(_error(view, run, alpha))]
    best = _simplest(view, usable, alpha)
    shown = [run for run in (best, stock) if run is not None] or choice[:1]
    more = _more(view, with_gravity, best, choice, alpha)
    return PageAnswer(_sentence(view, best, stock, alpha), more, best, shown)


def _simplest(view: View, usable: Sequence[RunKey], alpha: float) -> RunKey | None:
    """The one with the least error; of several as good one without a plug-in."""
    near = [run for run in usable if _error(view, run, alpha) <= (1 + TIE) * _error(view, usable[0], alpha)]
    return min(near, key=view.is_plugin, default=None)


def _error(view: View, run: RunKey, alpha: float) -> float:
    """Largest error of e; inf for a run that gains energy, loses impacts, or lacks what gravity asks."""
    score = view.score(run, alpha)
    if score is None or score["failed"] or score["energy_gained"] or lacks(view, run):
        return math.inf
    return float(score["max_error_law"])


def largest_error(view: View, run: RunKey, alpha: float) -> float:
    """Largest error of e against the law over all speeds and phases, NaN for none."""
    score = view.score(run, alpha)
    return math.nan if score is None else float(score["max_error_law"])


def _sentence(view: View, best: RunKey | None, stock: RunKey | None, alpha: float) -> str:
    off = "" if stock is None else wording.bound(largest_error(view, stock, alpha))
    out_of_the_box = f" With nothing set: wrong by at most {off}." if off else ""
    if best is None:
        return f"No setting of this study is good enough here.{out_of_the_box}"
    verb = "Attach" if view.is_plugin(best) else "Set"
    return (
        f"{verb} {best.setting}: e within {_off(view, best, alpha)} of the law.{_band(view)}{out_of_the_box}"
    )


def _band(view: View) -> str:
    """The impact speeds that the errors are of, as a sentence."""
    low, high = (f"{v:.2g}" for v in view.band)
    return f" Impacts of {wording.span(low, high)}{wording.NBSP}m/s."


def _off(view: View, run: RunKey, alpha: float) -> str:
    return wording.bound(largest_error(view, run, alpha))


def _more(
    view: View, with_gravity: View | None, best: RunKey | None, choice: Sequence[RunKey], alpha: float
) -> list[str]:
    lines = []
    if best is not None:
        lines.append(f"{best.label}: {_summary(view, with_gravity, best)}")
    if best is not None and view.is_plugin(best):
        plain = [run for run in choice if not view.is_plugin(run) and math.isfinite(_error(view, run, alpha))]
        if plain:
            within = f"e within {_off(view, plain[0], alpha)}. {_summary(view, with_gravity, plain[0])}"
            lines.append(f"No plug-in? {plain[0].label}, {within}")
    worst_first = sorted(choice, key=lambda run: (not lacks(view, run), -largest_error(view, run, alpha)))
    warnings = [f"{run.label} ({why})" for run in worst_first if (why := _why_not(view, run, alpha))]
    if warnings:
        lines.append(f"Do not use {wording.listed(warnings[:_WARNED], 'or')}.")
    score = next((s for run in choice if (s := view.score(run, alpha)) is not None), None)
    if score is not None:
        lines.append(f"The best constant e is wrong by {wording.bound(score['constant_error_law'])}.")
    if view.gravity and not math.isclose(alpha, view.main_alpha):
        lines.append(f"Rest after a drop was measured at {wording.alpha_short(view.main_alpha)} only.")
    return lines


def _why_not(view: View, run: RunKey, alpha: float) -> str:
    """Why not to use a setting; "" for no reason."""
    score, missing = view.score(run, alpha), lacks(view, run)
    if score is None:
        return ""
    if score["failed"]:
        return "loses impacts"
    if score["energy_gained"]:
        return "gains energy"
    if missing or grade(view, over_constant(score)) == "bad":
        return wording.listed([f"wrong by {_off(view, run, alpha)}", *missing])
    return ""


def _summary(view: View, with_gravity: View | None, run: RunKey) -> str:
    """The summary of a recipe, and what the setting lacks under gravity."""
    record = next(record for record in view.results.settings if view.run_of(record) == run)
    missing = lacks(with_gravity, run) if with_gravity is not None and with_gravity is not view else ()
    but = f" Not under gravity: there it {wording.listed(missing)}." if missing else ""
    return wording.sentence(str(record["summary"])) + but


def conditions(view: View, with_gravity: View | None) -> Mapping[tuple[str, float, float], PageAnswer]:
    """(engine, step, α) -> its answer, for all that ran over a band."""
    runs = [run for run in view.band_runs if run.engine != REFERENCE]
    keys = dict.fromkeys(
        (run.engine, run.timestep, alpha)
        for run in runs
        for alpha in view.alphas
        if view.score(run, alpha) is not None
    )
    return {key: answer(view, with_gravity, *key) for key in keys}
