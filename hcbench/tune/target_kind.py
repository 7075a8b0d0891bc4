"""Describes the kind of a target (law, linear or points), and refuses those that a recipe does not serve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from hcbench import scoring
from hcbench.errors import SettingError
from hcbench.laws.restitution import MeasuredRestitution

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.tune.target import Target, TargetKind

_FITS = 0.25  # of what one e for all speeds is off by: what the law may be off by to be worth a try
_WORDS = {"law": "α of eq. (16), by --alpha", "linear": "1 - α v, by --alpha and --target linear"}


def law_that_fits(target: Target) -> str:
    """The law that a target's pairs lie near, in words; "" where they are one, or near no law."""
    if len(target.points) < 2:
        return ""
    measured = MeasuredRestitution(target.points)
    speeds, e = measured.speeds, measured.values
    alpha, rms = scoring.fit_alpha(speeds, e)
    if rms > _FITS * float(np.ptp(e)) / 2:
        return ""
    return f"α = {alpha:.4g} s/m fits these pairs with rms {rms:.1g}: try --alpha {alpha:.4g}"


def describe(target: Target) -> tuple[str, str]:
    """What a target asks for as a user says it: the slot it came by, and the thing."""
    if target.reading == "points":
        pairs = f"{len(target.points)} pairs of v and e"
        return "restitution", pairs if len(target.points) > 1 else "one e for all speeds"
    return "target", _WORDS[target.reading].partition(",")[0]


def require_kind(target: Target, name: str, kinds: Sequence[TargetKind], instead: str) -> None:
    """Refuse what the recipe `name` does not serve: SettingError, with the recipes to use `instead`."""
    if target.reading in kinds:
        return
    slot, given = describe(target)
    expected = " or ".join(_WORDS[kind] for kind in kinds)
    fit = law_that_fits(target)
    todo = f"Use {instead} for another restitution" + (f". {fit}" if fit else "")
    raise SettingError(slot, f"{given}, which {name!r} does not serve", expected, todo)
