"""Choice of the law that the data support, by the odds between the laws."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

ODDS_TO_TELL, ODDS_OVER_E0 = 25.0, 3.0
PLAIN, WITH_E0 = "hunt-crossley", "hunt-crossley with e0"
EITHER = "hunt-crossley, with or without e0"
FAMILY = (PLAIN, WITH_E0, EITHER)


def chosen_law(evidence: Mapping[str, float]) -> str | None:
    """Choose the law by ln of each law's evidence; None if several are left.

    Eq. (16) with and without e0 are one family: a law outside it must be 25 times less likely than the better
    of the two, and 25 : 1 between the two then decide on e0. A constant e is a case of the law with e0, which
    therefore does not count against it where it is behind; the others need less of a lead over that law, for
    it can bend towards any of them.
    """
    names = sorted(evidence, key=lambda name: -evidence[name])
    best = names[0]
    in_family = best in FAMILY
    for name in names[1:]:
        behind = evidence[best] - evidence[name]
        if (in_family and name in FAMILY) or (best == "constant" and name == WITH_E0):
            continue
        if behind < math.log(ODDS_OVER_E0 if name == WITH_E0 else ODDS_TO_TELL):
            return None
    if not in_family:
        return best
    lead = evidence[PLAIN] - evidence[WITH_E0]
    return EITHER if abs(lead) < math.log(ODDS_TO_TELL) else best


def laws_left(evidence: Mapping[str, float], odds: float = ODDS_TO_TELL) -> set[str]:
    """Laws that are not ruled out at these odds by the likeliest."""
    top = max(evidence.values())
    return {name for name, one in evidence.items() if one > top - math.log(odds)}


def odds_of(evidence: Mapping[str, float]) -> dict[str, float]:
    """Odds of each law against the likeliest of the others."""
    odds = {}
    for name, one in evidence.items():
        best_of_others = max(e for other, e in evidence.items() if other != name)
        log_odds = max(-700.0, min(700.0, one - best_of_others))  # exp of more overflows
        odds[name] = math.exp(log_odds)
    return odds
