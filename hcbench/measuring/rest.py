"""Rest of two bodies on each other, and causes of penetration or vibration: each fix is tried
alone.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from hcbench.measuring.measurement import Cause
from hcbench.sim.rest import VIBRATION_MAX
from hcbench.system.errors import HcbenchError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.sim.model_under_test import ModelUnderTest, Suspect
    from hcbench.sim.rest import Rest
    from hcbench.terms.impact import Impact

# The fix of this cause takes the weight away, so that nothing rests.
_OTHER_WEIGHT = ("gravity",)
_UNITS = {"penetration": "m", "vibration": "m/s"}
# A fix helps if it leaves less than this share of the excess.
_HELPS = 0.5


@dataclass(frozen=True, slots=True)
class RestLimits:
    """The largest penetration (m) and vibration (m/s, rms) of a pair at rest, infinite for no
    limit; hcbench looks for causes above.

    of_user: whether the user gave them; then a vibration that still dies away is held to its limit,
    too.
    """

    penetration: float = 1e-3
    vibration: float = VIBRATION_MAX
    of_user: bool = False

    @property
    def text(self) -> str:
        """The limits as a phrase, without those that are infinite; at least one is finite."""
        phrases = []
        if not math.isinf(self.penetration):
            phrases.append(f"penetration of {1e3 * self.penetration:g} mm")
        if not math.isinf(self.vibration):
            phrases.append(f"vibration of {self.vibration:g} m/s")
        return f"at most a {' and a '.join(phrases)} at rest"

    def beyond(self, rest: Rest | None) -> dict[str, tuple[float, float]]:
        """(value, limit) of each quantity above its limit, "penetration" (m) or "vibration" (m/s);
        empty where none is.

        rest: the pair at rest; None where the two do not rest: then both values are NaN, which is
        above any limit. A vibration that dies away counts only if the user gave the limits.
        """
        calms = rest is not None and rest.dies_away and not self.of_user
        names = ("penetration",) if calms else ("penetration", "vibration")
        beyond = {}
        for name in names:
            value = getattr(rest, name, math.nan)
            most = getattr(self, name)
            if not value <= most:
                beyond[name] = (value, most)
        return beyond


ANY_REST = RestLimits(math.inf, math.inf)


def at_rest(
    model: ModelUnderTest, limits: RestLimits | None, impacts: Sequence[Impact]
) -> tuple[Rest | None, list[Suspect]]:
    """Measure the pair at rest, and list what can be tried to bring it within limits.

    limits: of penetration and vibration; None: nothing is measured.
    impacts: of the same model, by which it names suspects.
    Returns the pair at rest, None where it was not measured or does not rest; and suspects with a
    fix, likeliest first, none where the pair is within the limits.
    """
    if limits is None:
        return None, []
    rest = model.at_rest()
    if rest is None or not limits.beyond(rest):
        return rest, []
    suspects = [*model.rest_suspects(), *model.suspects(impacts, None)]
    return rest, [s for s in suspects if s.apply is not None and s.code not in _OTHER_WEIGHT]


def rest_causes(
    model: ModelUnderTest, rest: Rest | None, limits: RestLimits | None, suspects: Sequence[Suspect]
) -> tuple[Cause, ...]:
    """Causes that keep the pair from resting within the limits: fixes that alone halve an excess,
    best first.

    rest: the pair at rest; None where it does not rest.
    suspects: what can be tried, the likeliest first.
    limits: None for no causes.
    """
    if limits is None:
        return ()
    # What is beyond its limit, by the name of the quantity.
    excess: dict[str, float] = {}
    for name, (value, _limit) in limits.beyond(rest).items():
        if math.isfinite(value):
            excess[name] = value
    if not excess:
        return ()
    # By code: the share of the excess that the fix leaves, and the cause.
    causes: dict[str, tuple[float, Cause]] = {}
    for suspect in suspects:
        after = _fixed_rest(model, suspect)
        if after is None:
            continue
        # The quantity that this fix helps most.
        shares = [(getattr(after, name) / before, name) for name, before in excess.items()]
        left, name = min(shares)
        if left < _HELPS:
            before = excess[name]
            unit = _UNITS[name]
            change = f"{name} at rest {before:.2g} {unit}, with this fix {left * before:.2g} {unit}"
            cause = Cause(suspect.code, suspect.title, f"{suspect.evidence}; {change}", suspect.fix)
            causes.setdefault(suspect.code, (left, cause))
    best_first = sorted(causes.values(), key=lambda left_and_cause: left_and_cause[0])
    return tuple(cause for _, cause in best_first)


def _fixed_rest(model: ModelUnderTest, suspect: Suspect) -> Rest | None:
    """The pair at rest with one fix made; None where it then does not rest, or cannot be measured."""
    try:
        with model.fixed([suspect]) as fixed:
            rest = fixed.at_rest()
    except HcbenchError:
        return None
    return rest if rest is not None and math.isfinite(rest.penetration) else None
