"""Helps of commands: each option is explained in one place, and named in all."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator

import click
import pytest

from hcbench.cli import app, run
from hcbench.cli.help import Command, Group

MOST = 200  # options explained, in all helps together


def commands(group: Group = app, path: str = "hcbench") -> Iterator[tuple[str, click.Command]]:
    """Yield what a user can call, and its subcommands, by the words that call it."""
    yield path, group
    for name, each in group.commands.items():
        if isinstance(each, Group):
            yield from commands(each, f"{path} {name}")
        elif not each.hidden:
            yield f"{path} {name}", each


def help_of(path: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The text that `--help` prints."""
    assert run([*path.split()[1:], "--help"]) == 0
    return capsys.readouterr().out


def explained(text: str) -> list[str]:
    """Options that a help has words for."""
    return re.findall(r"^  (?:-\w, )?(--[\w-]+)(?= .*\S|$)", text, re.MULTILINE)


def test_fewer_than_200_options_are_explained(capsys: pytest.CaptureFixture[str]) -> None:
    found: Counter[str] = Counter()
    for path, _ in commands():
        words = path
        if path == "hcbench report":
            words += " reality"
        text = help_of(words, capsys)
        found.update(explained(text.split("As in `")[0]))
    assert 100 < found.total() < MOST
    assert found["--beyond-bounds"] == found["--json"] == found["--force"] == 1
    assert found["--qpos"] == found["--phases"] == found["--heights"] == 1


@pytest.mark.parametrize("path", [path for path, each in commands() if isinstance(each, Command)])
def test_a_help_names_every_option_of_its_command(
    path: str, capsys: pytest.CaptureFixture[str]
) -> None:
    each = dict(commands())[path]
    words = f"{path} reality" if path == "hcbench report" else path
    text = help_of(words, capsys)
    named = set(re.findall(r"--[\w-]+", text))
    wanted = {max(p.opts, key=len) for p in each.params if isinstance(p, click.Option)}
    assert wanted <= named


def test_what_a_help_leaves_to_another_is_explained_there(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for path, each in commands():
        if not isinstance(each, Command):
            continue
        for home, names in re.findall(
            r"As in `(.*) --help`:\n((?:  --.*\n)+)", help_of(path, capsys)
        ):
            assert set(names.split()) <= set(explained(help_of(home, capsys))), (path, home)
