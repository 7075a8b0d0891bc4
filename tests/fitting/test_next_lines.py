"""The commands that `fit` prints to type next run as they stand."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from measured_bounces import synthesise, times_of, write

from hcbench.cli import run
from hcbench.fitting import next_lines


def typed_next(out: str) -> list[list[str]]:
    lines = out.partition("next:\n")[2].replace("\\\n", " ").splitlines()
    return [shlex.split(line)[1:] for line in lines if line.startswith("  hcbench ")]


@pytest.mark.parametrize(
    ("law", "begins"),
    [
        (synthesise.hunt_crossley(0.3), ["tune", "check"]),
        (synthesise.constant(0.8), ["tune", "check"]),
        (synthesise.plastic(0.8), ["fit", "tune", "check"]),
    ],
)
def test_the_next_lines_run_as_they_stand(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    law: synthesise.Law,
    begins: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    times = times_of(law, 2, most=14, timing=5e-5)
    write(tmp_path, "time [s]\n" + "\n".join(f"{t:.6f}" for t in times), "a drop.csv")
    assert run(["fit", "a drop.csv"]) == 0
    lines = typed_next(capsys.readouterr().out)
    assert [line[0] for line in lines] == begins
    for line in lines:
        ends = run(line)
        # Only α has a plug-in that meets it exactly: else `check` says
        # by how much the scene is off.
        assert ends == 0 or (ends == 1 and line[0] == "check" and "--alpha" not in line)


def test_a_scene_that_was_written_is_checked_within_what_makes_up_for_its_contacts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    times = times_of(synthesise.hunt_crossley(0.3), 1, timing=5e-5, scatter=1e-3, most=14)
    write(tmp_path, "time [s]\n" + "\n".join(f"{t:.6f}" for t in times), "drop.csv")
    scene = [
        "--engine",
        "mujoco",
        "--timestep",
        "2e-3",
        "--write-scene",
        "s.xml",
        "--page",
        "p.html",
    ]
    assert run(["fit", "drop.csv", *scene]) == 0
    out = capsys.readouterr().out
    assert "α of the scene is" in out
    (line,) = typed_next(out)
    assert line[:2] == ["check", "s.xml"]
    assert run(line) == 0
    assert "Both trains of touches" in (tmp_path / "p.html").read_text(encoding="utf-8")
    comment, _, model = (tmp_path / "s.xml").read_text(encoding="utf-8").partition("-->")
    assert 'plugin="hcbench.restitution"' in model
    assert comment.startswith("<!--")
    assert "`hcbench plugin mujoco`" in comment


@pytest.mark.parametrize(
    "speeds", [(1.9811, 1.9889), (0.50012, 0.50018), (0.3, 0.3)], ids=["narrow", "narrower", "one"]
)
def test_the_band_of_a_narrow_measurement_lies_within_it(speeds: tuple[float, float]) -> None:
    low, high = next_lines._inwards(*speeds)
    assert speeds[0] - 1e-9 <= low <= high <= speeds[1] + 1e-9
    # As printed, with six digits.
    assert float(f"{low:g}") <= float(f"{high:g}")
