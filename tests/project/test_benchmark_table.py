"""Pages that show a run of the benchmarks: what falls short, and the times that README tells."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def table(monkeypatch: pytest.MonkeyPatch) -> Any:
    """benchmarks/table.py."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    return import_module("table")


def row(what: str, must: str, unit: str = "s", **seconds: float) -> dict[str, Any]:
    return {"extra_info": {"what": what, "must": must, "unit": unit, "seconds": seconds}}


def test_what_misses_its_limit_is_listed(table: Any) -> None:
    rows = [
        row("slow", "0.5 s", hcbench=0.8),
        row("fast", "0.5 s", hcbench=0.4),
        row("twice", "3", others=2.0, hcbench=1.0),
        row("nearly as fast", "1/1.2", others=0.9, hcbench=1.0),
        row("a thousand times", "10⁴", others=1e3, hcbench=1.0),
        row("large", "1 GiB", unit="MiB", hcbench=1025.0),
        row("no limit", "", hcbench=9.0),
    ]
    assert table.shortfalls({"benchmarks": rows}) == [
        "- slow: 800 ms, must 0.5 s;",
        "- twice: 2, must 3;",
        "- a thousand times: 1e+03, must 10⁴;",
        "- large: 1.02e+03 MiB, must 1 GiB.",
    ]


def test_the_sentence_on_speed_gets_the_times_of_a_run(table: Any) -> None:
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = [
        row(what, "", hcbench=seconds)
        for what, seconds in zip(table.TOLD, (7, 0.5, 0.4), strict=True)
    ]
    told = " ".join(table.told(front, {"benchmarks": rows}).split())
    assert "A million drops take 7 s of a processor in MuJoCo, e of a robot's foot 500 ms" in told
    assert "the plug-in's text 400 ms (" in told
    assert len(re.findall("million drops", told)) == front.count("million drops")
