"""What a setting did on a data set: an error for each of its motions or bounces."""

from dataclasses import dataclass

from hcbench.impact import Floats


@dataclass(frozen=True, slots=True)
class Outcome:
    """Errors in the set's unit, and what a search makes least, shape (n,); rotations in rad, of tosses."""

    errors: Floats
    scores: Floats
    rotations: Floats | None = None
