"""Causes of too much penetration or vibration at rest: fixes that alone take away half of it."""

from __future__ import annotations

from contextlib import contextmanager
from types import SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from hcbench.measuring.measurement import Cause
from hcbench.measuring.rest import RestLimits, rest_causes
from hcbench.measuring.text import all_cause_lines
from hcbench.sim.model_under_test import Suspect
from hcbench.sim.rest import Rest

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.measuring.measurement import Measurement
    from hcbench.sim.model_under_test import ModelUnderTest

LIMITS = RestLimits(penetration=1e-3, vibration=1e-3, of_user=True)


def lying(penetration: float, vibration: float) -> Rest:
    return Rest(penetration, sinking=0.0, vibration=vibration, decay=1.0)


class Fixed:
    """A model whose pair lies as each fix, by its code, lets it."""

    def __init__(self, after: dict[str, Rest], made: str = "") -> None:
        self.after = after
        self.made = made

    @contextmanager
    def fixed(self, fixes: Sequence[Suspect]) -> Iterator[Fixed]:
        (fix,) = fixes
        yield Fixed(self.after, fix.code)

    def at_rest(self) -> Rest:
        return self.after[self.made]


def causes(before: Rest, after: dict[str, Rest]) -> list[str]:
    """Codes of the causes, in their order."""
    suspects = [Suspect(code, f"{code}.", "a number", "a text") for code in after]
    model = cast("ModelUnderTest", Fixed(after))
    return [cause.code for cause in rest_causes(model, before, LIMITS, suspects)]


@pytest.mark.parametrize(("left", "is_cause"), [(0.49, True), (0.51, False)])
def test_a_fix_that_alone_halves_what_is_too_much_is_a_cause(left: float, is_cause: bool) -> None:
    for before, after in (
        (lying(4e-3, 0.0), lying(left * 4e-3, 0.0)),
        (lying(0.0, 0.02), lying(0.0, left * 0.02)),
    ):
        assert causes(before, {"fix": after}) == (["fix"] if is_cause else [])


def test_the_fix_that_leaves_the_least_comes_first() -> None:
    before = lying(4e-3, 0.0)
    after = {"some": lying(1.5e-3, 0.0), "most": lying(1e-4, 0.0), "none": lying(4e-3, 0.0)}
    assert causes(before, after) == ["most", "some"]


def test_a_pair_within_its_limits_has_no_causes() -> None:
    assert causes(lying(0.9e-3, 0.9e-3), {"fix": lying(0.0, 0.0)}) == []


def test_a_cause_of_bounce_and_rest_is_printed_once() -> None:
    both = Cause("default-solref", "solref is the default.", "solref 0.02 1", "a text")
    resting = Cause(both.code, both.title, "vibration at rest 6.8 m/s, with this fix 1.3 m/s", "")
    alone = Cause("long-step", "The step is too long.", "a step of 0.004 s", "a text")
    found = SimpleNamespace(causes=(both,), remedy="", rest_causes=(resting, alone))
    lines = all_cause_lines(cast("Measurement", found))
    titles = [line for line in lines if line.startswith(("default-solref", "long-step"))]
    assert titles == [
        "default-solref: solref is the default.",
        "default-solref acts at rest, too: vibration at rest 6.8 m/s, with this fix 1.3 m/s",
        "long-step: The step is too long.",
    ]
