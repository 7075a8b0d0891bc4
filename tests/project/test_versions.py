"""The table of versions: what was measured is what the page says, of
the commands and floors that are.
"""

from __future__ import annotations

import json

import versions

from hcbench import cli

MEASURED: dict[str, dict[str, str]] = json.loads(versions.MEASURED.read_text(encoding="utf-8"))


def test_the_page_says_what_was_measured() -> None:
    assert versions.PAGE.read_text(encoding="utf-8") == versions.page()


def test_every_command_works_on_the_floors_and_on_the_newest() -> None:
    floors = versions.floors()
    assert versions.BEFORE.keys() <= floors.keys()
    wanted = ["all at their floors", *(f"Python 3.{minor}" for minor in (11, 12, 13, 14))]
    for name in [*wanted, *(f"{package} {floors[package]}" for package in versions.BEFORE)]:
        assert not any(MEASURED[name].values()), name


def test_every_command_of_hcbench_is_among_those_that_are_run() -> None:
    run = {command.split()[0] for command in versions.COMMANDS}
    # Without an engine, from a file that ships, and minutes long: `make test-pythons` runs them.
    without = {"completion", "docs", "materials", "paper"}
    assert set(cli.app.commands) - run == without
