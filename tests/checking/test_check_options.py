"""Options and the tables of pyproject.toml: mistakes are refused before anything runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from checks import EXAMPLES, ask

from hcbench.checking import CheckSpec, Outputs, Verdict, check, plan
from hcbench.checking.text import as_text, checks_of
from hcbench.system.errors import UserError


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"alpha": "0.008 s/in", "restitution": 0.9}, "alpha and restitution"),
        ({"restitution": 1.5}, "0 ... 1"),
        ({"alpha": -1.0}, "0 s/m or more"),
        ({"alpha": "0.008 kg"}, "does not fit"),
        ({"alpha": 0.1, "target": "cubic"}, "law"),
        ({"restitution": 0.9, "max_error": 3}, "max-error"),
        ({"restitution": 0.9, "max_error": "wide"}, "not a number"),
        ({"restitution": 0.9, "limit": 0}, "above 0"),
        ({"restitution": 0.9, "height": 1e20}, "1e-09 ... 10000 m"),
        ({"restitution": 0.9, "speeds": "0 m/s"}, "above 0"),
        ({"restitution": 0.9, "target": "linear"}, "target: 'linear' given without an α"),
        ({"restitution": 0.9, "along": "0, 1, 0"}, "nothing oblique"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_anything_runs(
    more: dict[str, Any], words: str
) -> None:
    with pytest.raises(UserError, match=words):
        plan(ask(**more))


def test_speeds_outside_the_measured_pairs_are_refused(tmp_path: Path) -> None:
    file = tmp_path / "pairs.csv"
    file.write_text("v [m/s],e\n0.1,0.95\n0.5,0.9\n")
    with pytest.raises(UserError, match="within the measured pairs"):
        plan(ask(points=file, speeds="2 m/s"))


def test_outputs_that_cannot_be_written_are_refused_first(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="does not exist"):
        check(ask(restitution=0.9), Outputs(junit=tmp_path / "no" / "junit.xml"))
    with pytest.raises(UserError, match="is a folder"):
        check(ask(restitution=0.9), Outputs(png=tmp_path))


def test_a_pyproject_lists_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(EXAMPLES)
    report = check(CheckSpec(model=()))
    assert [o.verdict for o in report.outcomes] == [Verdict.PASSED, Verdict.FAILED]
    assert report.exit_code == 1
    assert check(CheckSpec(model=(), max_error=0.5)).exit_code == 0
    monkeypatch.chdir(tmp_path)
    assert check(CheckSpec(model=str(EXAMPLES / "pyproject.toml"))).exit_code == 1, (
        "paths start at the file"
    )
    with pytest.raises(UserError, match=r"no model, and no pyproject\.toml"):
        check(CheckSpec(model=()))


def test_a_table_says_for_all_checks_what_they_do_not_say_themselves(tmp_path: Path) -> None:
    """`actuators = false` for all was ignored."""
    entries = "".join(
        f"[[check]]\nname = '{n}'\nmodel = 'x'\n{more}\n"
        for n, more in [("a", ""), ("b", "actuators = true"), ("c", "speeds = 0.2")]
    )
    (tmp_path / "checks.toml").write_text(f"actuators = false\nspeeds = 0.1\n{entries}")
    requests = [check.request for check in checks_of(tmp_path / "checks.toml")]
    assert [request.actuators for request in requests] == [False, True, False]
    assert [request.speeds for request in requests] == [(0.1,), (0.1,), (0.2,)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[tool.hcbench]\n", "check"),
        ("[tool.other]\n", r"no \[tool.hcbench\]"),
        ("[[tool.hcbench.check]]\nmodle = 'x'\n", "modle|model"),
        ("[[tool.hcbench.check]]\nmodel = 1\n", "model"),
        ("[[tool.hcbench.check]]\nmodel = 'x'\nmax-error = 'lots'\n", "max-error"),
        (
            "[[tool.hcbench.check]]\nmodel = 'x'\nmax-error = true\n",
            "max-error: True; expected a number",
        ),
        ("[[tool.hcbench.check]]\nmodel = 'x'\nspeeds = [0.1, true]\n", "speeds"),
        ("[[tool.hcbench.check]]\nmodel = 'x'\nphases = true\n", "phases"),
        ("[[tool.hcbench.check]]\nmodel = 'x'\nactuators = 1\n", "actuators: 1"),
        ("[[tool.hcbench.check]]\nmodel = []\n", "model: none given"),
        ("[tool.hcbench]\nlimit = false\n[[tool.hcbench.check]]\nmodel = 'x'\n", "limit"),
        ("not toml", "not TOML"),
        ("[[tool.hcbench.check]]\nmodel='a'\n[[tool.hcbench.check]]\nmodel='a'\n", "two checks"),
    ],
)
def test_a_table_with_a_mistake_names_it(tmp_path: Path, text: str, words: str) -> None:
    file = tmp_path / "pyproject.toml"
    file.write_text(text)
    with pytest.raises(UserError, match=words) as caught:
        check(CheckSpec(model=str(file)))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("place", ["entry", "table"])
def test_paths_of_a_pose_and_a_controller_start_at_the_folder_of_the_file(
    place: str, tmp_path: Path
) -> None:
    (tmp_path / "pose.json").write_text('{"knee": 0.1}')
    pose = 'state = "pose.json"\n'
    (tmp_path / "checks.toml").write_text(
        (pose if place == "table" else "")
        + '[[check]]\nmodel = "m.xml"\n'
        + (pose if place == "entry" else "")
        + 'require = "peak < 8"\ncontroller = "walk.py:policy"\n'
    )
    (planned,) = checks_of(tmp_path / "checks.toml")
    assert planned.request.pose == (("knee", (0.1,)),)
    assert planned.drops is not None
    assert planned.drops.controller == str(tmp_path / "walk.py:policy")


def test_a_baseline_of_several_checks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(EXAMPLES)
    file = tmp_path / "all.json"
    check(CheckSpec(model=()), Outputs(baseline=file))
    again = check(CheckSpec(model=(), baseline=file))
    assert again.exit_code == 0, as_text(again)
    assert len(again.outcomes) == 2
