"""The headline of the field page: sentences that help to choose an engine."""

from __future__ import annotations

import math
from itertools import combinations
from typing import TYPE_CHECKING

from hcbench.reporting.field.view import NO_BOUNCE, Case
from hcbench.reporting.ranking import LOOP_NEAR
from hcbench.reporting.wording import listed, number, percent, span, time
from hcbench.sim import registry

if TYPE_CHECKING:
    from hcbench.reporting.field.view import FieldView

_NAMED = 5  # engines in a sentence, at most
_ROBOT_STEP = 1e-3  # s


def headline(view: FieldView) -> list[str]:
    """Sentences, the most important first; those that the study cannot answer are left out."""
    sentences = [_law(view), _robots(view), _loops(view), _as_it_comes(view), _gains(view), _versions(view)]
    return [sentence for sentence in sentences if sentence]


def _law(view: FieldView) -> str:
    """Who follows the law at the finest step, with numbers to set."""
    step = view.steps[0]
    best = _sorted(view, view.gravities[0], step)
    follow = [_named(view, case) for case in best if view.follows_law(case)]
    if not follow:
        return f"At a step of {time(step)}, {band(view, step)}, no engine follows the law by settings alone."
    rest = f" and {len(follow) - _NAMED} more" if len(follow) > _NAMED else ""
    named = f"{listed(follow[:_NAMED])}{rest}"
    return f"At a step of {time(step)}, {band(view, step)}, these follow the law by settings alone: {named}."


def _robots(view: FieldView) -> str:
    """Who is nearest at a step of about 1 ms under gravity."""
    step, gravity = min(view.steps, key=lambda h: abs(math.log(h / _ROBOT_STEP))), view.gravities[-1]
    best = _sorted(view, gravity, step)
    if not best:
        return ""
    nearest = listed([_named(view, case) for case in best[:3]])
    where = " under gravity" if gravity else ""
    return (
        f"At {time(step)}{where}, {band(view, step)}, the nearest are {nearest}; "
        f"the best constant e is wrong by {number(view.constant_error(step))}.{_left_out(view, best)}"
    )


def band(view: FieldView, timestep: float) -> str:
    """The impact speeds at a step."""
    speeds = view.speeds(timestep)
    return f"{span(f'{speeds[0]:.3g}', f'{speeds[-1]:.3g}')} m/s"


def _left_out(view: FieldView, best: list[Case]) -> str:
    """Settings of the engines that are named which would be nearer, and why they are not."""
    words = [
        f"{view.title(case.engine)} {left_out(view, other)}"
        for case in best[:3]
        for other in view.cases(case.engine, case.gravity, case.timestep)
        if math.isinf(view.error(other)) and view.off(other) < view.error(case)
    ]
    return f" Left out: {listed(words)}." if words else ""


def left_out(view: FieldView, case: Case) -> str:
    """A setting that is not the best, and why."""
    if view.gains(case):
        why = f"gains energy: e up to {number(view.restitution(case)[1])}"
    else:
        why = "loses impacts"
    return f"{case.setting} ({number(view.off(case))}, {why})"


def _loops(view: FieldView) -> str:
    """Whose force also follows the law."""
    near: dict[str, tuple[float, Case]] = {}
    for case, score in view.scores.items():
        recipe, rms = view.recipe(case), float(score["loop_rms"])
        own = recipe is not None and recipe.native and not case.gravity and case.engine in view.engines
        if own and score["loops"] and rms <= LOOP_NEAR and not view.gains(case):
            engine = registry.base_name(case.engine)
            near[engine] = min(near.get(engine, (rms, case)), (rms, case))
    words = [f"{view.title(c.engine)} {c.setting} ({percent(rms)})" for rms, c in sorted(near.values())]
    return f"The force over penetration also follows the law in {listed(words)}." if words else ""


def _as_it_comes(view: FieldView) -> str:
    """Who does not bounce with nothing set, and who loses the ball."""
    still, lost = [], []
    for engine in view.engines:
        cases = [c for h in view.steps if (c := view.stock(engine, view.gravities[0], h)) is not None]
        if cases and all(view.lost(case) for case in cases):
            lost.append(f"{view.title(engine)} ({view.lost(cases[0])})")
        elif cases and max(view.restitution(case)[1] for case in cases) < NO_BOUNCE:
            still.append(view.title(engine))
    parts = [f"no bounce at any step in {listed(still)}"] if still else []
    parts += [f"no contact that holds the ball in {listed(lost)}"] if lost else []
    return f"With nothing set: {'; '.join(parts)}." if parts else ""


def _gains(view: FieldView) -> str:
    """Who gives a body more speed than it had."""
    gains: dict[str, list[Case]] = {}
    for case in view.scores:
        if case.engine in view.engines and view.gains(case):
            gains.setdefault(case.engine, []).append(case)
    words = []
    for engine, cases in gains.items():
        stock = [case for case in cases if case.setting == "stock"]
        worst = max(stock or cases, key=lambda case: view.restitution(case)[1])
        name = "with nothing set" if stock else worst.setting
        high = view.restitution(worst)[1]
        where = f"{time(worst.timestep)}{' under gravity' if worst.gravity else ''}"
        words.append(f"{view.title(engine)} {name} (e up to {number(high)} at {where})")
    return f"The contact adds energy: {listed(words)}." if words else ""


def _versions(view: FieldView) -> str:
    """What another version of an engine changed."""
    words = []
    for one, other in combinations(view.engines, 2):
        if registry.base_name(one) != registry.base_name(other):
            continue
        differences = [
            float((a["restitution"] - b["restitution"].to_numpy()).abs().max())
            for case, a in view.impacts.items()
            if case.engine == one and (b := view.impacts.get(case._replace(engine=other))) is not None
        ]
        largest = max((d for d in differences if math.isfinite(d)), default=math.nan)
        alike = f"bounce alike in all {len(differences)} runs"
        off = (
            alike
            if largest == 0.0
            else f"differ in e by up to {number(largest)} over {len(differences)} runs"
        )
        words.append(f"{view.title(one)} and {view.title(other)} {off}")
    return f"{'; '.join(words)}." if words else ""


def _sorted(view: FieldView, gravity: float, timestep: float) -> list[Case]:
    """The best case of each engine at a step, nearest first; of several versions the nearest alone."""
    best = [c for engine in view.engines if (c := view.best(engine, gravity, timestep)) is not None]
    by_error = sorted(best, key=view.error)
    return list({registry.base_name(case.engine): case for case in reversed(by_error)}.values())[::-1]


def _named(view: FieldView, case: Case) -> str:
    return f"{view.title(case.engine)} {case.setting} ({number(view.error(case))})"
