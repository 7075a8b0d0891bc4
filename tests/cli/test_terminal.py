"""Output at a terminal: helps with examples, lines of 100 columns, colour, the next command."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from hcbench.cli import app, run
from hcbench.cli.console import WIDTH, folded
from hcbench.cli.help import examples

pytestmark = pytest.mark.usefixtures("tuned_once")

ROOT = Path(__file__).parents[2]
GOOD = str(ROOT / "examples" / "good.xml")
FEW = ["--pair=ball,plate", "--speeds=0.2, 0.5 m/s", "--phases=1"]
OUTPUTS = [
    ["law", "--alpha=0.3 s/m", "--speeds=0.1, 0.5, 1 m/s"],
    ["convert", "--alpha=0.3 s/m", "--speed=1 m/s", "--timestep=1 ms", "--contact-time=0.2 ms"],
    ["engines"],
    ["engines", "-v"],
    ["pairs", GOOD],
    ["measure", GOOD, *FEW, "--alpha=0.3"],
    ["check", GOOD, *FEW, "--restitution=0.9"],
    ["tune", "mujoco", "--alpha=0.3 s/m", "--timestep=2 ms", "--plugin"],
    ["tune", "pybullet", "--restitution=0.8", "--timestep=2 ms"],
]
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


def commands(command: click.Command, path: tuple[str, ...]) -> Iterator[tuple[str, click.Command]]:
    yield " ".join(path), command
    if isinstance(command, click.Group):
        for name, each in command.commands.items():
            yield from commands(each, (*path, name))


COMMANDS = dict(commands(app, ("hcbench",)))


def parsed(line: str) -> None:
    """The line is a command that hcbench takes."""
    name, *words = shlex.split(line.replace("\\\n", " ").split(" >> ")[0])
    assert name == "hcbench"
    command: click.Command = app
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        command = command.commands[words.pop(0)]
    command.make_context(command.name, words)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_help_fits_and_says_what_each_option_takes(name: str) -> None:
    command = COMMANDS[name]
    text = command.get_help(click.Context(command, info_name=name, terminal_width=WIDTH))
    assert max(map(len, text.splitlines())) <= WIDTH
    assert not re.findall(r"^ +--\S+ (?:TEXT|PATH|FLOAT|VALUE)\b", text, re.MULTILINE)


@pytest.mark.parametrize("name", app.commands)
def test_the_examples_of_a_help_are_commands_and_its_page_is_there(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(click.Path, "convert", lambda self, value, param, ctx: Path(str(value)))
    assert examples(name)
    for line in examples(name):
        parsed(line)
    text = app.commands[name].get_help(click.Context(app.commands[name]))
    assert all(line in text for line in examples(name))
    (page,) = re.findall(r"Documentation: hcbench docs (\S+)", text)
    assert (ROOT / "docs" / f"{page}.md").is_file()


@pytest.mark.parametrize("command", OUTPUTS, ids=lambda c: " ".join(c)[:30])
def test_no_line_of_an_output_is_longer_than_100_columns(
    command: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(command) in (0, 1)
    out = capsys.readouterr().out
    assert out
    # A promise in the text to paste is one attribute, which stays on its line.
    printed = [line for line in out.splitlines() if not line.startswith('data="')]
    assert [line for line in printed if len(line) > WIDTH] == []
    if command[0] in ("measure", "tune"):
        # A title says where lines go that no file has.
        _, line = re.split(r"\nnext(?:, .+)?:\n", out)
        parsed(line.strip())


def test_a_line_is_folded_by_what_it_is() -> None:
    words = "word " * 40
    assert all(len(line) <= WIDTH for line in folded([f"name   {words}", words, f"- {words}"]))
    assert [line[:9] for line in folded([f"name   {words}"])] == [
        "name   wo",
        "       wo",
        "       wo",
    ]
    command = f'  hcbench tune {"x" * 60} --alpha "0.3 s/m" --timestep "2 ms" --plugin'
    first, second = folded([command])
    assert first.endswith(" \\") and second.startswith("      --")
    assert shlex.split(f"{first}\n{second}".replace("\\\n", "")) == shlex.split(command)
    tag = '<pair geom1="ball" geom2="plate" condim="1" solref="-7 -2.000" solimp="0.0001 0.0001 1 0.5 1"/>'
    assert " ".join(line.strip() for line in folded([tag])) == tag


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_shell_completes_commands(
    shell: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    if shell != "bash" or Path("/bin/bash").exists():
        assert run(["completion", shell]) == 0
        assert "_HCBENCH_COMPLETE" in capsys.readouterr().out
    monkeypatch.setenv("_HCBENCH_COMPLETE", f"{shell}_complete")
    monkeypatch.setenv("COMP_WORDS", "hcbench tu")
    monkeypatch.setenv("COMP_CWORD", "tu" if shell == "fish" else "1")
    assert run([]) == 0
    assert "tune" in capsys.readouterr().out


@needs_pty
def test_a_verdict_is_green_on_a_terminal_unless_no_color_is_set() -> None:
    import pty

    main, child = pty.openpty()
    code = f"import os; from hcbench.cli import run; c = {['check', GOOD, *FEW, '--restitution=0.9']!r};"
    code += "run(c); os.environ['NO_COLOR'] = '1'; run(c)"
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"} | {"TERM": "xterm"}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=child, stderr=subprocess.DEVNULL, env=environment
    ):
        os.close(child)
        shown = b""
        try:
            while part := os.read(main, 4096):
                shown += part
        except OSError:  # the other end is closed
            pass
    os.close(main)
    verdicts = [line for line in shown.decode().splitlines() if "PASSED" in line]
    assert [line.startswith("\x1b[32m") for line in verdicts] == [True, False]
    assert "\x1b" not in verdicts[1]
