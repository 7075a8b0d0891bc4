"""Fixes that are tried: a fix that does not help costs one launch."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, cast

import pytest

from hcbench.measuring.diagnose import _Trials
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Suspect
from hcbench.terms.impact import Launch

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

SPEEDS = (0.1, 0.5, 2.0)


class _Impact:
    def __init__(self, speed_in: float, restitution: float) -> None:
        self.speed_in = speed_in
        self.restitution = restitution


class _Model:
    """A model whose e is 0.9 less its faults; each fault is of one suspect, by its code."""

    def __init__(self, faults: dict[str, float], fixed: frozenset[str] = frozenset()) -> None:
        self.faults = faults
        self.fixed_codes = fixed

    @contextmanager
    def fixed(self, suspects: Sequence[Suspect]) -> Iterator[_Model]:
        yield _Model(self.faults, frozenset(one.code for one in suspects))

    def restitution(self, speed: float) -> float:
        left = [fault for code, fault in self.faults.items() if code not in self.fixed_codes]
        return 0.9 - sum(left) * speed / max(SPEEDS)


@pytest.fixture
def launched(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Speeds of all launches, in order."""
    speeds: list[float] = []

    def impacts_in(model: _Model, launches: Sequence[Launch]) -> list[_Impact]:
        speeds.extend(launch.speed for launch in launches)
        return [_Impact(launch.speed, model.restitution(launch.speed)) for launch in launches]

    monkeypatch.setattr(simulate, "impacts_in", impacts_in)
    return speeds


def suspect(code: str) -> Suspect:
    return Suspect(code, "", "", "", lambda _: None)


def trials(faults: dict[str, float]) -> _Trials:
    launches = [Launch(speed) for speed in SPEEDS]
    return _Trials(cast(Any, _Model(faults)), launches, lambda _: 0.9)


def test_a_fix_that_does_not_help_is_launched_once(launched: list[float]) -> None:
    tried = trials({"a": 0.3})
    before = tried.max_error([])
    launched.clear()
    assert not tried.keeps([suspect("b")], lambda error: error < 0.5 * before)
    # The launch that is most wrong, the fastest.
    assert launched == [2.0]


def test_a_fix_that_helps_is_judged_by_all_launches(launched: list[float]) -> None:
    tried = trials({"a": 0.3, "b": 0.05})
    tried.max_error([])
    launched.clear()
    assert tried.keeps([suspect("a")], lambda error: error < 0.1)
    assert launched == [2.0, *SPEEDS]
    launched.clear()
    assert tried.keeps([suspect("a")], lambda error: error < 0.06)
    assert not launched
