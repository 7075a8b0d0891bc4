"""`hcbench docs`: the pages that helps name are there after an installation, without the repository."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from hcbench.cli import COMMANDS, app, run

ROOT = Path(__file__).parents[2]


def test_it_lists_every_page_and_prints_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["docs"]) == 0
    listed = capsys.readouterr().out
    assert re.search(r"^tutorial +\S", listed, re.MULTILINE)
    assert re.search(r"^howto/tune +\S", listed, re.MULTILINE)
    for name in ("howto/tune", "docs/howto/tune.md"):
        assert run(["docs", name]) == 0
        assert capsys.readouterr().out == (ROOT / "docs/howto/tune.md").read_text(encoding="utf-8")


def test_a_page_that_is_another_file_is_that_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["docs", "scenes"]) == 0
    assert capsys.readouterr().out.strip().startswith("# ")


def test_a_section_is_printed_alone(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["docs", "causes#gravity"]) == 0
    section = capsys.readouterr().out
    assert section.startswith("### gravity\n\nGravity changes the speed")
    assert section.count("#") == 3
    assert run(["docs", "causes#gravitas"]) == 2
    assert "one of: gravity" in capsys.readouterr().err


def test_a_comment_in_code_does_not_end_a_section(capsys: pytest.CaptureFixture[str]) -> None:
    page = (ROOT / "docs/howto/plugin-pybullet.md").read_text(encoding="utf-8")
    before_code = page[: page.index("\n# ")]
    title = re.findall(r"^#+ (.+)$", before_code, re.MULTILINE)[-1]
    anchor = re.sub(r"[^\w-]", "", title.lower().replace(" ", "-"))
    assert run(["docs", f"howto/plugin-pybullet#{anchor}"]) == 0
    section = capsys.readouterr().out
    assert "\n# " in section
    assert section.count("```") % 2 == 0


def test_an_unknown_page_is_answered_by_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["docs", "howto/tone"]) == 2
    assert "howto/tune" in capsys.readouterr().err


@pytest.mark.parametrize("command", [None, *COMMANDS], ids=lambda c: c.name if c else "hcbench")
def test_a_help_ends_with_a_command_that_prints_its_page(
    command: object, capsys: pytest.CaptureFixture[str]
) -> None:
    epilog = str(getattr(command, "epilog", app.epilog))
    last = epilog.strip().splitlines()[-1]
    assert last.startswith("Documentation: hcbench docs")
    assert run(last.removeprefix("Documentation: hcbench ").split()) == 0
    assert capsys.readouterr().out


def test_the_wheel_has_every_page_that_helps_name() -> None:
    config = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    shipped = config["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    pages = [path for path in shipped if path.startswith("docs/")]
    assert all(shipped[path] == f"hcbench/data/{path}" for path in pages)
    named = [str(c.epilog).rsplit("hcbench docs ", 1)[1].strip() for c in COMMANDS]
    for name in named:
        assert any(f"docs/{name}.md".startswith(path) for path in pages), name
