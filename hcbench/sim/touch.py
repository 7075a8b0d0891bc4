"""Brings two bodies just to touch, in any engine, and refuses those that cannot be brought there.

An engine moves one of the two along a line and says how far apart they are, or whether it makes a contact.
"""

import itertools
import math
from collections.abc import Callable

import numpy as np

from hcbench.system.errors import SceneError, UserError

# Of the smaller one's size: an overlap at the start up to which it is just moved out
DEEPEST = 0.1
# Share of a joint's motion that must be along the normal for it to launch a body
LEAST_APPROACH = 1e-3
_ROUNDS = 60
_SEEN = 1e-9  # m: an overlap that is more than rounding
# Times the smallest distance: two that are so far apart again will not meet
_PASSED = 4.0
_SCAN_STEPS = 200
# Of the smaller one's size: a distance that counts as touching
_CLOSE = 1e-12


def travel_by_distance(distance: Callable[[float], float], size: float, approach: float = 1.0) -> float:
    """Find the travel at which the two touch or are nearest; converges in one iteration for convex
    shapes on a straight approach.

    distance: moves to a travel and returns the signed distance there, m. size: of the smaller one, m.
    approach: how much the distance falls a unit of travel.
    """
    travel = best = 0.0
    nearest = math.inf
    for _ in range(_ROUNDS):
        gap = distance(travel)
        if abs(gap) > _PASSED * nearest:  # they have passed each other
            return best
        if abs(gap) <= nearest:
            nearest, best = abs(gap), travel
        travel += gap / approach
        if abs(gap) < _CLOSE * size:
            break
    return travel


def travel_by_scan(touches: Callable[[float], bool], start: float, stop: float) -> float | None:
    """The least travel from `start` to `stop` that makes a contact; None where nothing touches.

    For shapes whose distance is known only roughly: equal steps, then bisection.
    """
    travels = np.linspace(start, stop, _SCAN_STEPS + 1).tolist()
    begun = next((pair for pair in itertools.pairwise(travels) if touches(pair[1])), None)
    if begun is None:
        return None
    low, high = begun
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if touches(middle) else (middle, high)
    return float(high)


def overlap_notes(overlap: float) -> list[str]:
    """Note that the bodies overlapped by this many m at the start; empty if the overlap is
    negligible.
    """
    said = f"The two overlap by {overlap:.3g} m at the start: moved apart to touch."
    return [said] if overlap > _SEEN else []


def require_apart(
    distance: float, size: float, first: str, second: str, advice: str = "Move one away"
) -> None:
    """Raise SceneError for two that start deep in each other. distance: signed, m. first, second: names."""
    if distance < -DEEPEST * size:
        got = f"{first!r} starts {-distance:.4g} m inside {second!r}"
        raise SceneError("model", got, "the two bodies apart or just touching", advice)


def require_reachable(
    depth: float, size: float, pair: tuple[str, str], blocked: tuple[str, str], advice: str = ""
) -> None:
    """Raise UserError for a touch at which another part of what moves is deep in something.

    depth: of that part, m. size: of the smaller one, m. pair: names of the two that should meet, the moving
    body first. blocked: the part that moves with it, and what it would be in, as an error calls them.
    """
    if depth > DEEPEST * size:
        raise UserError(
            "pair",
            f"{pair[0]!r} cannot reach {pair[1]!r}: {blocked[0]}, which moves with it, would be "
            f"{depth:.3g} m inside {blocked[1]}",
            "two that meet before anything else does",
            f"Name the parts that meet first{advice}",
        )
