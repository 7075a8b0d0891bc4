"""Errors of a setting on a data set: one for each of its motions or bounces."""

from dataclasses import dataclass

from hcbench.terms.impact import Floats


@dataclass(frozen=True, slots=True)
class SettingErrors:
    """Errors in the set's unit, shape (n,); of tosses rotations
    (rad), and scores that combine both.
    """

    errors: Floats
    scores: Floats
    rotations: Floats | None = None
