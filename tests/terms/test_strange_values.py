"""Values of a caller's own classes: refused by name, or taken for what they are."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import hcbench as hb
from hcbench.system.errors import UserError

BALL = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
<body pos="0 0 1"><freejoint/><geom name="ball" size=".1" mass="1"/></body></worldbody></mujoco>"""


class Word(str):
    """A kind of text of the caller's own, which a worker process cannot import."""

    __slots__ = ()


class Silent:
    """An object that fails when it is shown."""

    def __repr__(self) -> str:
        raise RuntimeError("not shown")


def test_a_callers_kind_of_text_is_text(tmp_path: Path) -> None:
    path = tmp_path / "ball.xml"
    path.write_text(BALL)
    landed = hb.land(path, heights=0.01, controller=Word("pd"))
    assert landed.controller == hb.land(path, heights=0.01).controller


@pytest.mark.parametrize(
    ("call", "slot"),
    [
        (hb.law, "alpha"),
        (lambda bad: hb.law(0.1, exponent=bad), "exponent"),
        (hb.measure, "model"),
        (lambda bad: hb.measure("ball.xml", pair=bad), "pair"),
        (lambda bad: hb.land("ball.xml", controller=bad), "controller"),
        (hb.fit, "files"),
    ],
)
def test_an_object_that_cannot_be_shown_is_refused_by_its_type(
    call: Callable[[Any], Any], slot: str
) -> None:
    with pytest.raises(UserError, match="a Silent") as refused:
        call(Silent())
    assert refused.value.slot == slot
