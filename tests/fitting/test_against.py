"""`--against`: whether two materials differ, and by how much, from files to the verdict."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from measured_bounces import synthesise, times_of, write

import hcbench
from hcbench.cli import run


def drops(folder: Path, name: str, alpha: float, seeds: range) -> list[str]:
    law = synthesise.hunt_crossley(alpha)
    return [
        write(
            folder,
            "time [s]\n" + "\n".join(f"{t:.6f}" for t in times_of(law, seed)),
            f"{name}{seed}.csv",
        )
        for seed in seeds
    ]


@pytest.mark.parametrize(
    ("other", "verdict"), [(0.3, "the materials differ"), (0.2, "no difference is seen")]
)
def test_two_materials_are_compared(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], other: float, verdict: str
) -> None:
    ours, theirs = drops(tmp_path, "a", 0.2, range(3)), drops(tmp_path, "b", other, range(10, 13))
    assert run(["fit", *ours, "--against", *theirs, "--json"]) == 0
    (against,) = json.loads(capsys.readouterr().out)["against"]
    assert against["compared"] == "alpha"
    assert against["differ"] == (other != 0.2)
    assert against["ratio"]["low"] < 0.2 / other < against["ratio"]["high"]
    assert against["files"] == ["b10.csv", "b11.csv", "b12.csv"]
    found = hcbench.fit(*ours, against=theirs)
    assert found.against is not None
    assert (found.against.differ, found.against.ratio.value) == (
        against["differ"],
        against["ratio"]["value"],
    )
    assert verdict in repr(found)


def test_the_command_prints_the_verdict(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (ours,), (theirs,) = drops(tmp_path, "a", 0.2, range(1)), drops(tmp_path, "b", 1.0, range(1))
    assert run(["fit", ours, "--against", theirs]) == 0
    assert "the materials differ" in capsys.readouterr().out
