"""Tunes the feet of a robot by how it lands as a whole: the rebound of its centre of mass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.sim.landing import DropTest, Reach, few_steps
from hcbench.sim.model_under_test import ModelSetting, Texts
from hcbench.sim.rest import UNKNOWN
from hcbench.system.errors import UserError
from hcbench.tuning.tuned_model import AS_IT_IS, LandingChange, TunedModel

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from hcbench.sim.capabilities import TunesModels
    from hcbench.sim.model_under_test import Output, Request

# Whole tests of settings that have the rebound, and of those that come nearest, at most: of these the
# first are at the edge of what lands no worse.
_JUDGED = 6
_NEAREST = 20


@dataclass(frozen=True, slots=True)
class _Judged:
    """A setting with its whole test, and what it makes worse."""

    setting: ModelSetting
    test: DropTest
    worse: tuple[str, ...]

    def meets(self, rebound: float) -> bool:
        """Say whether it has the rebound, m, and nothing worse."""
        return not self.worse and self.test.meets(rebound)


def landing_as_it_is(
    engine: TunesModels, source: Any, requests: Sequence[Request]
) -> DropTest | None:
    """Drop the robot of the pairs in the model as it is; None where they are not of a robot."""
    try:
        return engine.landing(source, requests)
    except UserError:
        return None


def tune_landing(
    engine: TunesModels,
    source: Any,
    requests: Sequence[Request],
    before: DropTest,
    rebound: float,
    output: Output,
) -> TunedModel:
    """Find a setting of a robot's feet with which its centre of mass rebounds by so much, and with
    which nothing else of its landing is worse.

    source, requests: the model, and one request for each foot with the floor.
    before: the landing of the model as it is, which is the answer where it has the rebound.
    rebound: the target, m.
    output: where the texts are to be written.
    Else the answer is the first setting that has the rebound and makes nothing worse; or the one
    that makes the fewest quantities worse, of those whose rebound is nearer than the model's.
    Raises UserError where the drops of the model as it is have no end.
    """
    if before.diverged:
        got = "the robot flies off, or never lands, in drops of the model as it is"
        advice = "Try a smaller --timestep, another pose, or smaller gains"
        raise UserError("model", got, "a robot that lands", advice)
    if before.meets(rebound):
        return _tuned(None, LandingChange(before, before, rebound), output)
    found = engine.rebound_settings(source, requests, before, rebound)

    def judged(
        settings: Iterable[ModelSetting], most: int, is_good: Callable[[_Judged], bool]
    ) -> list[_Judged]:
        """Drop the robot with each setting, up to the first that is good or to `most` settings."""
        dropped: list[_Judged] = []
        for setting in settings:
            test = engine.landing(setting.source, requests, before)
            dropped.append(_Judged(setting, test, tuple(test.worse_than(before, rebound))))
            if is_good(dropped[-1]) or len(dropped) == most:
                break
        return dropped

    # `found` has lazy searches: settings that met the rebound in a quick drop, those that came
    # nearest without making anything worse, and those that trade another quantity for it.
    tried = judged(found.meeting, _JUDGED, lambda one: one.meets(rebound))
    if not any(one.meets(rebound) for one in tried):
        tried += judged(found.nearest, _NEAREST, lambda one: not one.worse)
    if not _nearer(tried, before, rebound):
        # None that was whole comes nearer: one that is not shows the price.
        tried += judged(found.trading, 1, lambda _: True)
    best = next((one for one in tried if one.meets(rebound)), None)
    if best is not None:
        change = LandingChange(before, best.test, rebound, advice=found.advice)
        return _tuned(best.setting, change, output)
    possible = [before, *(one.test for one in tried if not one.worse)]
    reach = None
    # A rebound that is chance is in reach: nothing of the servos makes it less of one.
    if not any(test.is_near(rebound) for test in possible):
        reached = min((test.rebound for test in possible), key=lambda height: abs(height - rebound))
        reach = Reach(reached, found.stiffer())
    # What comes nearest is printed with all that it makes worse.
    nearer = sorted(
        _nearer(tried, before, rebound),
        key=lambda one: (one.test.diverged, len(one.worse), abs(one.test.rebound - rebound)),
    )
    if not nearer:
        return _tuned(None, LandingChange(before, before, rebound, reach, found.advice), output)
    change = LandingChange(before, nearer[0].test, rebound, reach, found.advice)
    return _tuned(nearer[0].setting, change, output)


def _nearer(tried: Sequence[_Judged], before: DropTest, rebound: float) -> list[_Judged]:
    """Those whose rebound is nearer to the target, m, than that of the model as it is."""
    own = abs(before.rebound - rebound)
    return [one for one in tried if abs(one.test.rebound - rebound) < own]


def _tuned(setting: ModelSetting | None, change: LandingChange, output: Output) -> TunedModel:
    """The answer with a setting of the feet; with the model as it is for None.

    change: the landing before and after.
    output: where the texts are to be written.
    """
    name = AS_IT_IS
    texts = Texts("")
    notes: tuple[str, ...] = ()
    if setting is not None:
        name = setting.name
        texts = setting.texts((), output)
        notes = (*setting.notes, *few_steps(change.after.contact, change.after.robot.timestep))
    return TunedModel(name, texts, notes, (), (), UNKNOWN, UNKNOWN, landing=change)
