"""Names of parts of a model, and the parts they stand for."""

from __future__ import annotations

import pytest

from hcbench.sim.packages import find_part, suggest_names
from hcbench.system.errors import UserError

PARTS = [("body", "ball", 1), ("geom", "ball", 0), ("geom", "plate", 2), ("geom", "geom:3", 3)]


@pytest.mark.parametrize(
    ("request_", "part"),
    [
        ("ball", ("body", 1)),
        ("geom:ball", ("geom", 0)),
        ("geom:2", ("geom", 2)),
        ("geom:3", ("geom", 3)),
        ("plate", ("geom", 2)),
    ],
)
def test_the_first_of_a_name_is_meant_unless_its_kind_is_given(
    request_: str, part: tuple[str, int]
) -> None:
    assert find_part(PARTS, request_) == part


@pytest.mark.parametrize("request_", ["bal", "body:plate", "body:7", ""])
def test_what_is_not_there_is_refused_with_the_names_that_are(request_: str) -> None:
    with pytest.raises(
        UserError, match=f"no body or geom '{request_}'.*one of: ball, plate, geom:3"
    ):
        find_part(PARTS, request_)


def test_the_nearest_name_is_suggested_and_a_long_list_is_cut() -> None:
    expected, nearest = suggest_names("prt20", [f"part{i}" for i in range(30)])
    assert nearest == "Did you mean 'part20'?"
    assert expected.endswith("part11, ...")
    assert suggest_names("x", ["", ""]) == ("one of: none has a name", "")
