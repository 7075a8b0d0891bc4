"""Files of a release, without building it: versions, links, the recipe,
the paper, and what is missing.
"""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path
from typing import Any

import jinja2
import pytest
import yaml
from release_check import facts

ROOT = Path(__file__).parents[2]
PROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "project"
]
PAPER = (ROOT / "paper.md").read_text(encoding="utf-8")
CITATION: dict[str, Any] = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def recipe() -> dict[str, Any]:
    """The recipe as conda build reads it: rendered by Jinja, then parsed."""

    def load_file_data(name: str, from_recipe_dir: bool) -> dict[str, Any]:
        assert from_recipe_dir
        return tomllib.loads((ROOT / "conda" / "recipe" / name).read_text(encoding="utf-8"))

    template = jinja2.Template(
        (ROOT / "conda" / "recipe" / "meta.yaml").read_text(encoding="utf-8")
    )
    content: dict[str, Any] = yaml.safe_load(
        template.render(load_file_data=load_file_data, PYTHON="python")
    )
    return content


def test_the_recipe_has_the_version_the_dependencies_and_the_command_of_the_project() -> None:
    content = recipe()
    assert content["package"] == {"name": "hcbench", "version": PROJECT["version"]}
    of_conda = {"mujoco": "mujoco-python", "matplotlib": "matplotlib-base"}
    everywhere = [
        re.match(r"([\w-]+)(.*)", text) for text in PROJECT["dependencies"] if ";" not in text
    ]
    wanted = [f"{of_conda.get(found[1], found[1])} {found[2]}" for found in everywhere if found]
    assert content["requirements"]["run"] == [f"python {PROJECT['requires-python']}", *wanted]
    assert content["build"]["entry_points"] == ["hcbench = hcbench.__main__:main"]
    assert content["about"]["license"] == PROJECT["license"]


def test_zenodo_and_the_citation_say_the_same() -> None:
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    assert zenodo["title"] == CITATION["title"]
    assert zenodo["description"] == CITATION["abstract"]
    assert zenodo["keywords"] == CITATION["keywords"]
    assert zenodo["license"] == CITATION["license"] == PROJECT["license"]
    assert [person["name"] for person in zenodo["creators"]] == [
        a["name"] for a in CITATION["authors"]
    ]
    assert zenodo["related_identifiers"][0]["identifier"] == CITATION["references"][0]["doi"]


@pytest.mark.parametrize(
    "name", ["README.md", "paper.md", "CODE_OF_CONDUCT.md", "CONTRIBUTING.md", "SECURITY.md"]
)
def test_a_link_of_the_top_level_leads_to_a_file(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    links = re.findall(r"\]\((?!https?://|#)([^)#\s]+)[^)]*\)", text)
    assert not [link for link in links if not (ROOT / link).is_file()]


# A number of the paper, the page that has it, and its words there.
NUMBERS = [
    ("come within 0.031 of the law from 0.1 to 2 m/s", "docs/tutorial.md", "0.031 against e of the law"),
    ("α = 0.3 s/m at a step of 2 ms", "README.md", '--alpha "0.3 s/m" --timestep "2 ms"'),
    ("wrong by 0.18 there", "docs/tutorial.md", "wrong by at most 0.18"),
    ("steps of 1 to 5 ms. Two steel", "docs/explanation/engines.md", "steps of 1 to 5 ms. Two steel"),
    ("balls touch for 0.2 ms", "docs/explanation/engines.md", "balls touch for 0.2 ms"),
    ("gives 0.899 ... 1.057", "docs/explanation/models.md", "| `mujoco_docs.xml` | 0.899 ... 1.057 |"),
    ("from 0.000 to 1.013", "docs/explanation/models.md", "| `bullet.py:wall` | 0.000 ... 1.013 |"),
    ("Eighteen bounces", "docs/reference/cases.md", "[eighteen cases]"),
    ("MuJoCo 4.0.0 passes 17 of 18", "docs/reference/cases.md", r"^\| mujoco \| 4\.0\.0 \|.*\| 17 of 18 \|"),
    ("PyBullet 3.2.7 passes 18 of 18", "docs/reference/cases.md", r"^\| pybullet \| 3\.2.*\| 18 of 18 \|"),
    ("1718 impacts", "hcbench/reality/data/README.md", "1718 impacts"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "page", "there"), NUMBERS, ids=[words for words, *_ in NUMBERS])
def test_a_number_of_the_paper_is_in_the_documentation(words: str, page: str, there: str) -> None:
    text = (ROOT / page).read_text(encoding="utf-8")
    assert words in " ".join(PAPER.split())
    assert there in " ".join(text.split()) or there in text or re.search(there, text, re.MULTILINE)


def test_every_number_of_the_paper_with_decimals_is_one_of_those() -> None:
    prose = " ".join(PAPER.split("---\n", 2)[2].split())
    for words, *_ in NUMBERS:
        prose = prose.replace(words, "")
    assert not re.findall(r"\d+\.\d+|\d+ of \d+", prose)


def test_every_reference_of_the_paper_is_cited_and_listed() -> None:
    listed = re.findall(
        r"^@\w+\{(\w+),", (ROOT / "paper.bib").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert sorted(set(re.findall(r"@(\w+)\]", PAPER))) == sorted(listed)


def test_the_length_of_the_paper_is_what_joss_asks_for() -> None:
    assert 750 <= len(PAPER.split("---\n", 2)[2].split()) <= 1750


@pytest.fixture
def ready(tmp_path: Path) -> Path:
    """The repository's files of facts, with all that is missing filled in."""
    for name in ("pyproject.toml", "CHANGELOG.md", "CITATION.cff", "paper.md"):
        shutil.copy(ROOT / name, tmp_path / name)
    version = PROJECT["version"]
    fill(tmp_path / "pyproject.toml", r"https://[\w.]*\.invalid", "https://example.org")
    fill(
        tmp_path / "pyproject.toml",
        r'(authors = \[\{ name = "[^"]*")',
        r'\1, email = "a@example.org"',
    )
    fill(
        tmp_path / "CHANGELOG.md",
        rf"^## {re.escape(version)} \(.*\)$",
        f"## {version} (2027-01-31)",
    )
    fill(tmp_path / "CITATION.cff", r"^# doi: .*$", "doi: 10.5281/zenodo.1")
    fill(
        tmp_path / "CITATION.cff",
        r"^  - name: .*$",
        "  - name: A\n    orcid: https://orcid.org/0000-0000-0000-0000",
    )
    fill(tmp_path / "paper.md", r"^  - name: .*$", "  - name: A\n    affiliation: 1")
    fill(tmp_path / "paper.md", r"^date:$", "date: 31 January 2027")
    return tmp_path


def fill(file: Path, pattern: str, replacement: str) -> None:
    """Replace a pattern in a file, which has it."""
    text, count = re.subn(
        pattern, replacement, file.read_text(encoding="utf-8"), flags=re.MULTILINE
    )
    assert count, (file.name, pattern)
    file.write_text(text, encoding="utf-8")


def test_nothing_is_missing_where_all_is_filled_in(ready: Path) -> None:
    missing = facts(ready)
    assert not missing.blocking + missing.later


@pytest.mark.parametrize(
    ("name", "pattern", "replacement", "sentence"),
    [
        ("pyproject.toml", r"https://example\.org", "https://a.invalid", "The project has no address"),
        ("CHANGELOG.md", r"\(2027-01-31\)", "(unreleased)", "CHANGELOG.md has no date"),
        ("CITATION.cff", r"^version: .*$", "version: 9.9.9", "CITATION.cff has version 9.9.9"),
    ],
)  # fmt: skip
def test_what_blocks_a_release_is_named(
    ready: Path, name: str, pattern: str, replacement: str, sentence: str
) -> None:
    fill(ready / name, pattern, replacement)
    assert facts(ready).blocking[0].startswith(sentence)


@pytest.mark.parametrize(
    ("name", "pattern", "sentence"),
    [
        ("pyproject.toml", r', email = "[^"]*"', "No author has an e-mail address"),
        ("CITATION.cff", r"^doi: .*$", "CITATION.cff has no DOI"),
        ("CITATION.cff", r"^    orcid: .*$", "CITATION.cff names no people"),
        ("paper.md", r"^    affiliation: .*$", "paper.md names no people"),
        ("paper.md", r"^date: .*$", "paper.md has no date"),
    ],
)
def test_what_can_follow_a_release_is_named(
    ready: Path, name: str, pattern: str, sentence: str
) -> None:
    fill(ready / name, pattern, "" if "date" not in pattern else "date:")
    missing = facts(ready)
    assert not missing.blocking
    assert missing.later[0].startswith(sentence)
