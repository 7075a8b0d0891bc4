"""The documentation: it builds, loads nothing from outside, and its commands and code run."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from sybil import Sybil
from sybil.parsers.markdown import PythonCodeBlockParser, SkipParser

from hcbench.cli import app
from hcbench.laws import closed_form

pytestmark = pytest.mark.usefixtures("tuned_once")

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    ROOT / "README.md",
    ROOT / "examples" / "README.md",
    ROOT / "scenes" / "README.md",
    *(p for p in sorted(DOCS.rglob("*.md")) if "_build" not in p.parts),
]
PYTHON = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
FENCE = re.compile(r"^[ ]*```(sh|console|)\n(.*?)^[ ]*```$", re.MULTILINE | re.DOTALL)


def commands(page: Path) -> list[str]:
    """The lines of a page's shell blocks that call hcbench, continued lines joined."""
    lines = []
    for kind, block in FENCE.findall(page.read_text(encoding="utf-8")):
        named = [line.strip() for line in block.replace("\\\n", " ").splitlines()]
        lines += [
            line.removeprefix("$ ") for line in named if kind != "console" or line.startswith("$ ")
        ]
    return [line for line in lines if line.startswith("hcbench ")]


def evaluate(page: Path) -> None:
    """Run the Python blocks of a page, one after the other; the first that fails raises."""
    document = Sybil(parsers=[PythonCodeBlockParser(), SkipParser()], path=str(page.parent)).parse(
        page
    )
    for example in document.examples():
        example.evaluate()


def test_the_site_builds_without_a_warning_and_loads_nothing_from_outside(tmp_path: Path) -> None:
    """`make test` has just built it: then only a page that has changed since is read again."""
    out = tmp_path / "html"
    if (built := DOCS / "_build" / "html").is_dir():
        shutil.copytree(built, out)
    build = [sys.executable, "-m", "sphinx", "-q", "-W", str(DOCS), str(out)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    assert len(list(out.rglob("*.html"))) > 20
    folder = [sys.executable, str(DOCS / "site_folder.py"), str(out), str(tmp_path / "site")]
    linked = subprocess.run(folder, capture_output=True, text=True, check=False)
    assert not linked.returncode, f"links and requests: {linked.stdout}{linked.stderr}"
    for page in (tmp_path / "site").glob("*/**/*.html"):
        text = page.read_text(encoding="utf-8")
        assert text.count('class="hcbench-site"') == text.count('property="og:image"') == 1, page
    for style in out.rglob("*.css"):
        assert not re.search(
            r"(@import|url\()\s*[\"']?(https?:)?//", style.read_text(encoding="utf-8")
        ), style
    commands = (out / "reference" / "commands.html").read_text(encoding="utf-8")
    names = (out / "reference" / "api.html").read_text(encoding="utf-8")
    shown = [name for name, each in app.commands.items() if not each.hidden]
    assert all(f'id="hcbench-{name}"' in commands for name in shown)
    assert 'id="hcbench.contact.mujoco.add_to_spec"' in names and 'id="hcbench.Setting"' in names


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_every_command_that_a_page_shows_is_one(
    page: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(click.Path, "convert", lambda self, value, param, ctx: Path(str(value)))
    for line in commands(page):
        words = shlex.split(line.split(" > ")[0], comments=True)[1:]
        if words == ["--help"]:
            continue
        command: click.Command = app
        while isinstance(command, click.Group) and words and not words[0].startswith("-"):
            name = words.pop(0)
            assert name in command.commands, line
            command = command.commands[name]
        command.make_context(command.name, words)


@pytest.mark.spec_plugins
@pytest.mark.parametrize(
    "page", [p for p in PAGES if "```python" in p.read_text(encoding="utf-8")], ids=lambda p: p.name
)
def test_the_python_of_a_page_runs(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for file in (ROOT / "examples").glob("*.xml"):
        shutil.copy(file, tmp_path)
    shutil.copy(ROOT / "examples" / "good.xml", tmp_path / "ball.xml")
    shutil.copy(ROOT / "examples" / "good.xml", tmp_path / "model.xml")
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    monkeypatch.chdir(tmp_path)
    blocks = PYTHON.findall(page.read_text(encoding="utf-8"))
    if not any("pybullet" in block for block in blocks):
        evaluate(page)
        return
    pytest.importorskip("pybullet")
    code = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_docs as t; "
    )
    code += f"t.evaluate(t.Path({str(page)!r}))"  # its clients are those of a process
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr


def test_the_table_of_the_law_is_the_law() -> None:
    text = (DOCS / "explanation" / "law.md").read_text(encoding="utf-8")
    rows = {
        line.split("|")[1].strip(): [float(cell) for cell in line.split("|")[2:-1]]
        for line in text.splitlines()
        if line.startswith(("| α v |", "| e of the law |", "| 1 - α v |"))
    }
    speeds = rows["α v"]
    assert rows["e of the law"] == pytest.approx(
        [float(closed_form.restitution(v, 1.0)) for v in speeds], abs=6e-4
    )
    assert rows["1 - α v"] == pytest.approx([1 - v for v in speeds], abs=1e-9)


def test_the_times_of_the_readme_are_those_of_the_benchmarks() -> None:
    text = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
    takes = dict(re.findall(r"^\| ([^|]+) \| hcbench \| ([\d.]+ \w+) ", text, re.MULTILINE))
    rows = (
        "a million drops, MuJoCo at 1 ms, processor time",
        "hcbench measure of README's quadruped, processor time",
        "hcbench tune --plugin, processor time",
    )
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    drops, foot, plugin = (takes[row] for row in rows)
    assert f"A million drops take {drops} of a processor" in readme
    assert f"e of a robot's foot {foot}, the plug-in's text {plugin} (" in readme
