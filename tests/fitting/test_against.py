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
def test_two_materials_are_compared(tmp_path: Path, other: float, verdict: str) -> None:
    ours, theirs = drops(tmp_path, "a", 0.2, range(3)), drops(tmp_path, "b", other, range(10, 13))
    found = hcbench.fit(*ours, against=theirs)
    against = found.against
    assert against is not None
    assert against.compared == "alpha"
    assert against.differ == (other != 0.2)
    assert against.ratio.low < 0.2 / other < against.ratio.high
    assert against.files == ("b10.csv", "b11.csv", "b12.csv")
    assert verdict in repr(found)


@pytest.mark.parametrize("words", [["--against"], ["--against", "--json"]])
def test_against_without_a_file_is_an_error(tmp_path: Path, words: list[str]) -> None:
    """The option was dropped, and nothing was compared."""
    (ours,) = drops(tmp_path, "a", 0.2, range(1))
    assert run(["fit", ours, *words]) == 2


def test_the_command_prints_the_verdict_and_has_pythons_numbers_in_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (ours,), (theirs,) = drops(tmp_path, "a", 0.2, range(1)), drops(tmp_path, "b", 1.0, range(1))
    assert run(["fit", ours, "--against", theirs]) == 0
    assert "the materials differ" in capsys.readouterr().out
    assert run(["fit", ours, "--against", theirs, "--json"]) == 0
    (against,) = json.loads(capsys.readouterr().out)["against"]
    found = hcbench.fit(ours, against=theirs).against
    assert found is not None
    assert (against["compared"], against["files"]) == (found.compared, list(found.files))
    assert (against["differ"], against["ratio"]["value"]) == (found.differ, found.ratio.value)
    assert (against["ratio"]["low"], against["ratio"]["high"]) == (
        found.ratio.low,
        found.ratio.high,
    )
