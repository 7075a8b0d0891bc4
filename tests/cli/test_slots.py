"""A bad value is refused in the name of the option, or parameter, that it was given to."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import click
import pytest

import hcbench as hb
from hcbench.cli import app, run
from hcbench.system.errors import UserError

BALL = """<mujoco><worldbody>
<geom name="floor" type="plane" size="1 1 1"/>
<body pos="0 0 1"><freejoint/><geom name="ball" size=".1" mass="1"/></body>
</worldbody></mujoco>"""
# Words of each verb that a bad value is added to.
COMMANDS = {
    "law": ["law", "--alpha", "0.3", "--speeds", "1"],
    "fit": ["fit", "times.csv"],
    "tune an engine": ["tune", "mujoco", "--alpha", "0.3", "--timestep", "1e-3"],
    "tune a model": ["tune", "ball.xml", "--pair", "ball,floor", "--alpha", "0.3"],
    "pairs": ["pairs", "ball.xml"],
    "measure": ["measure", "ball.xml", "--pair", "ball,floor"],
    "check": ["check", "ball.xml", "--pair", "ball,floor", "--alpha", "0.3", "--speeds", "1"],
    "land": ["land", "ball.xml"],
    "convert": ["convert", "--alpha", "0.3"],
    "report": ["report", "steel-1lb"],
    "sweep": ["sweep", "steel-1lb", "--out", "results"],
}
CALLS: dict[str, tuple[Callable[..., Any], tuple[str, ...], dict[str, Any]]] = {
    "tune": (hb.tune, ("mujoco",), {"alpha": 0.3, "timestep": 1e-3}),
    "tune_model": (hb.tune_model, ("ball.xml",), {"pair": "ball,floor", "alpha": 0.3}),
    "measure": (hb.measure, ("ball.xml",), {"pair": "ball,floor"}),
    "fit": (hb.fit, ("times.csv",), {}),
    "fit_force": (hb.fit_force, ("times.csv",), {}),
    "land": (hb.land, ("ball.xml",), {}),
    "convert": (hb.convert, (), {"alpha": 0.3}),
    "law": (hb.law, (), {"alpha": 0.3}),
    "pairs": (hb.pairs, ("ball.xml",), {}),
}
# Each takes the place of alpha.
TARGETS = {"material", "restitution", "points", "adams", "newton", "drake", "simbody", "solref"}
TARGETS |= {"baseline", "require"}
# Text that is a name of a file or of a package's version is looked for, and named itself.
NAMES = {
    "--against",
    "--junit",
    "--markdown",
    "--png",
    "--for",
    "--write-scene",
    "--write-points",
    "--write-material",
    "--page",
}


def _options() -> Iterator[tuple[str, str]]:
    for verb, words in COMMANDS.items():
        for parameter in app.commands[words[0]].params:
            flag = parameter.opts[0]
            is_value = isinstance(parameter, click.Option) and not parameter.is_flag
            # Each of these files is written: any name of a file is a good value.
            if is_value and flag not in NAMES and not flag.startswith("--write"):
                yield verb, flag


def _parameters() -> Iterator[tuple[str, str]]:
    for verb, (function, first, _) in CALLS.items():
        for name, parameter in list(inspect.signature(function).parameters.items())[len(first) :]:
            if parameter.kind is not inspect.Parameter.VAR_POSITIONAL:
                yield verb, name


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("ball.xml").write_text(BALL)
    Path("times.csv").write_text("time [s]\n0\n0.286\n0.488\n0.643\n0.77\n")


@pytest.mark.parametrize(("verb", "option"), list(_options()))
def test_a_bad_value_is_refused_in_the_name_of_its_option(
    verb: str, option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = list(COMMANDS[verb])
    replaced = "--alpha" if option.removeprefix("--") in TARGETS else option
    if replaced in words:
        del words[words.index(replaced) : words.index(replaced) + 2]
    if option == "--out":
        # Any name is one of a folder, but that of a file.
        Path("☃").touch()
    code = run([*words, option, "☃"])
    printed = capsys.readouterr()
    (message,) = (printed.err or _mistake(printed.out)).strip().splitlines()[-1:]
    message = message.removeprefix("hcbench: ").removeprefix("Invalid value for ").lstrip("'")
    assert code in (2, 3)
    assert message.startswith(option)
    assert message.count(f"{option}:") <= 1


def _mistake(printed: str) -> str:
    """Text that `check` prints of a check that cannot be made, as of an option."""
    found = re.search(r"^MISTAKE ball\.xml: (.+)", printed, re.MULTILINE)
    return f"--{found[1]}" if found else ""


@pytest.mark.parametrize(("verb", "name"), list(_parameters()))
@pytest.mark.parametrize("bad", [b"bytes", {"one": b"1"}])
def test_a_bad_value_is_refused_in_the_name_of_its_parameter(
    verb: str, name: str, bad: object
) -> None:
    function, first, others = CALLS[verb]
    given = {key: value for key, value in others.items() if key != "alpha" or name not in TARGETS}
    with pytest.raises(UserError) as refused:
        function(*first, **{**given, name: bad})
    assert refused.value.slot == name
    assert str(refused.value).count(f"{name}:") == 1


def test_a_limit_that_is_passed_is_named_by_its_option(capsys: pytest.CaptureFixture[str]) -> None:
    # One recipe: no search over all. It is for balls.
    words = [*COMMANDS["tune an engine"], "--recipe", "compliant", "--corners", "1"]
    assert run([*words, "--max-error", "0"]) == 1
    assert capsys.readouterr().err.startswith("hcbench: --max-error: ")


@pytest.mark.parametrize("verb", ["law", "tune an engine"])
@pytest.mark.parametrize("exponent", ["-1", "0", "0.9"])
def test_an_exponent_below_1_is_refused_for_itself(
    verb: str, exponent: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*COMMANDS[verb], "--exponent", exponent]) == 2
    expected = f"hcbench: --exponent: {exponent}; expected 1 "
    assert capsys.readouterr().err.startswith(expected)


@pytest.mark.parametrize("restitution", [-1, 1.5])
def test_a_restitution_outside_0_to_1_is_refused_for_itself(restitution: float) -> None:
    with pytest.raises(UserError) as refused:
        hb.tune("mujoco", restitution=restitution, timestep=1e-3)
    assert refused.value.slot == "restitution"
