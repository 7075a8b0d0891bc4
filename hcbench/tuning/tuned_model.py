"""A setting for pairs of a user's own model, and what it does there."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hcbench.measuring.curve import Curve
from hcbench.sim.landing import DropTest, Reach
from hcbench.sim.model_under_test import Facts, Texts
from hcbench.sim.passivity import MOST_E
from hcbench.sim.rest import Standing
from hcbench.system.text import Shown, as_bound, joined_names
from hcbench.tuning.answer import MAX_ERROR

# Name of the setting that changes nothing.
AS_IT_IS = "as it is"
# Key of the count of contact points in `Facts.settings`.
_POINTS = "points of contact"
# Pairs that are printed, at most.
_SHOWN = 8
# A setting worth writing has an error below this multiple of the untuned one.
GAINS = 0.95


@dataclass(frozen=True, slots=True)
class TunedPair:
    """Result of a setting for one pair.

    curve: e at held-out speeds, rising, each at the phases between which e differs.
    attitude: of the body, such as "edge"; "" where it has but one.
    taken: how much of the speed at touch, at most, joints and servos take between the contact's
    last force and the touch plane; below 0 where they add to it.
    launches: how many there were: those of the curve, then others at speeds and phases that fill
    band and step evenly, and about the worst of all.
    beyond, highest: the largest error of e, and the largest e, in those others.
    failure: clause on a launch that has no e; "" where each has one.
    touches: whether each of the curve's launches touched at all, whatever its e.
    """

    facts: Facts
    curve: Curve
    attitude: str = ""
    taken: float = 0.0
    launches: int = 0
    beyond: float = 0.0
    highest: float = 0.0
    failure: str = ""
    touches: bool = True

    @property
    def max_error(self) -> float:
        """The largest error of e in any launch; infinite where an impact has no e."""
        if any(point.failed for point in self.curve):
            return math.inf
        return max(self.beyond, *(abs(point.worst_phase) for point in self.curve))

    @property
    def max_e(self) -> float:
        """The largest e in any launch."""
        return max(self.highest, *(point.highest for point in self.curve))

    @property
    def band(self) -> tuple[float, float]:
        """Mean speeds at touch of the slowest and the fastest launches, m/s."""
        return self.curve[0].speed_in, self.curve[-1].speed_in


@dataclass(frozen=True, slots=True)
class LandingChange:
    """Landing of a robot without and with a setting of its feet.

    rebound: the target, m; None where the target is an e of a foot.
    reach: what is possible; None where the target is met, is missed by chance alone, or is none of
    the rebound.
    advice: sentences on options of the model that spoil every landing.
    """

    before: DropTest
    after: DropTest
    rebound: float | None = None
    reach: Reach | None = None
    advice: tuple[str, ...] = ()

    @property
    def worse(self) -> list[str]:
        """Quantities of the landing that the setting makes worse than allowed, in words."""
        return list(self.after.worse_than(self.before, self.rebound or 0.0))

    @property
    def extreme(self) -> str:
        """The phrase for the rebound that is in `reach`: "largest rebound up to 5 mm" or "smallest
        rebound" where it stops short of the target, as seen from the model as it is; "nearest
        rebound" where it lies beyond the target. A search looks no farther than its target.

        Only for a landing with a `reach`.
        """
        assert self.reach is not None
        target = self.rebound or 0.0
        if (self.reach.rebound > target) != (self.before.rebound > target):
            return "nearest rebound"
        if self.before.rebound > target:
            return "smallest rebound"
        return f"largest rebound up to {1e3 * target:g} mm"

    @property
    def is_met(self) -> bool:
        """True if the rebound is that of the target, and nothing is worse."""
        return not self.worse and self.after.meets(self.rebound or 0.0)

    @property
    def misses(self) -> str:
        """Reasons why the target is not met, as a phrase: a worse landing, chance, or a rebound
        that is out of reach. It says nothing of use where the target is met.
        """
        if self.reach is None and self.worse:
            return f"the robot lands worse with it: {'; '.join(self.worse)}"
        if self.reach is None:
            mean, spread = 1e3 * self.after.rebound, 1e3 * self.after.spread
            return (
                f"a rebound of {mean:.3g} mm that varies by {spread:.2g} mm with where in a step the "
                "contact starts (chance)"
            )
        return f"the {self.extreme} without a worse landing is {1e3 * self.reach.rebound:.3g} mm"


@dataclass(frozen=True, repr=False)
class TunedModel(Shown):
    """A setting for pairs in their own model, and how it does there.

    texts: of the setting; its `written` is "" where the engine has no such text.
    pairs: in each attitude; () where the target is the rebound of a robot, which has no e.
    untuned: the same of the model as it was.
    before, after: how it stands without and with the setting.
    enough: error of e, within which a setting will do.
    files: what was written; () where nothing was.
    landing: of the robot whose feet the pairs are; None where they are not of a robot.
    """

    name: str
    texts: Texts
    notes: tuple[str, ...]
    pairs: tuple[TunedPair, ...]
    untuned: tuple[TunedPair, ...]
    before: Standing
    after: Standing
    enough: float = MAX_ERROR
    files: tuple[Path, ...] = ()
    landing: LandingChange | None = None

    def _lines(self) -> Iterator[str]:
        """Yield lines for a terminal: the rebound of a landing, e of each pair, and where the text is,
        or why nothing is written.
        """
        yield f"{self.model}: {self.name}"
        if self.landing is not None:
            was = 1e3 * self.landing.before.rebound
            now = 1e3 * self.landing.after.rebound
            yield f"rebound of the centre of mass from 10 cm: {was:.3g} mm before, {now:.3g} mm"
        for pair in self.pairs[:_SHOWN]:
            low, high = pair.band
            within = f"e within {as_bound(pair.max_error)} from {low:.3g} to {high:.3g} m/s"
            name = " on ".join(pair.facts.pair)
            if pair.attitude:
                name += f", {pair.attitude}"
            yield f"{name}: {within}"
        if self.gains:
            yield f"to paste: .text, {len(self.text.splitlines())} lines"
            for path in self.files:
                yield f"written: {path}"
        else:
            yield f"nothing is written: {self.no_gain}"

    def _rows(self) -> Iterator[dict[str, Any]]:
        for pair in self.pairs:
            for point in pair.curve:
                record = point.record(is_oblique=False)
                yield {"pair": joined_names(pair.facts.pair), "attitude": pair.attitude, **record}

    @property
    def model(self) -> str:
        """Name of the model's file."""
        return (
            self.pairs[0].facts.model if self.landing is None else self.landing.before.robot.model
        )

    @property
    def engine(self) -> str:
        """Name of the engine."""
        return (
            self.pairs[0].facts.engine if self.landing is None else self.landing.before.robot.engine
        )

    @property
    def text(self) -> str:
        """The text to paste: lines for the model or script."""
        return self.texts.paste

    @property
    def written(self) -> str:
        """The text of the whole model with the lines; `files` are those in which it was written."""
        return self.texts.written

    @property
    def max_error(self) -> float:
        """The largest of all pairs; NaN without pairs."""
        return largest_error(self.pairs)

    @property
    def max_e(self) -> float:
        """The largest e of all pairs in any phase; NaN without pairs."""
        return max((pair.max_e for pair in self.pairs), default=math.nan)

    @property
    def worse(self) -> list[str]:
        """Quantities that the setting makes worse than allowed, in words."""
        return list(self.after.worse_than(self.before))

    @property
    def gains(self) -> bool:
        """True if e is near enough to the target, or clearly nearer than in the model as it was, no
        launch gains energy, and a robot lands no worse; where the target is a rebound, if that is
        met.

        True also of a model that needs no setting because it is near enough as it is.
        """
        if self.landing is not None and self.landing.rebound is not None:
            return self.landing.is_met
        if self.landing is not None and self.landing.worse:
            return False
        if self.name == AS_IT_IS:
            return self.max_error <= self.enough
        if self.max_e > MOST_E:
            return False
        return self.max_error <= max(self.enough, GAINS * largest_error(self.untuned))

    @property
    def no_gain(self) -> str:
        """Reasons that leave nothing to write, as a phrase; "" where the setting gains."""
        if self.gains:
            return ""
        if self.landing is not None and (self.landing.worse or self.landing.rebound is not None):
            return self.landing.misses
        if self.name == AS_IT_IS:
            within = f"e within {as_bound(self.max_error)}"
            return f"the model as it is has {within}, and no setting that was found is nearer"
        if self.max_e > MOST_E:
            return f"e up to {self.max_e:.4g} with {self.name!r}: it gains energy"
        before = largest_error(self.untuned)
        found = f"{self.max_error:.2g} with the best setting that was found"
        return f"e is wrong by {before:.2g} in the model as it is, by {found}"

    @property
    def flat(self) -> bool | None:
        """True if no body that meets at several points (a face, an edge) gained energy in a launch:
        no e above 1 but for rounding; None without such a body.
        """
        highest = []
        for pair in self.pairs:
            if pair.attitude or pair.facts.settings.get(_POINTS, 1) > 1:
                highest += [point.highest for point in pair.curve]
        if not highest:
            return None
        return all(e <= MOST_E for e in highest)

    @property
    def taken(self) -> float:
        """Largest share of the speed at touch that joints and servos take after the contact's last
        force; below 0 if they add to it.
        """
        return max((pair.taken for pair in self.pairs), key=abs, default=math.nan)


def largest_error(pairs: Sequence[TunedPair]) -> float:
    """Largest error of e over all pairs."""
    return max((pair.max_error for pair in pairs), default=math.nan)
