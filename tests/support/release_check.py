"""Gaps in a release, in plain sentences: `make release-check`. Exit 1 if one blocks it."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[2]
# Each reads the built files; versions of the day on which they last passed.
TOOLS = {
    "twine==7.0.0": ["twine", "--no-color", "check", "--strict"],
    "check-wheel-contents==0.6.3": ["check-wheel-contents"],
    "cffconvert==2.0.0": ["cffconvert", "--validate", "-i"],
    "pyroma==5.0.1": ["pyroma", "--min=8"],  # 8 of 10 without an author's e-mail
}


@dataclass
class Missing:
    """Sentences: what blocks a release, and what can follow it."""

    blocking: list[str] = field(default_factory=list)
    later: list[str] = field(default_factory=list)


def facts(root: Path) -> Missing:
    """Facts that the files of the repository at root still lack."""
    missing = Missing()
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    changes = (root / "CHANGELOG.md").read_text(encoding="utf-8")
    citation = yaml.safe_load((root / "CITATION.cff").read_text(encoding="utf-8"))
    _, front_matter, _ = (root / "paper.md").read_text(encoding="utf-8").split("---\n", 2)
    paper = yaml.safe_load(front_matter)
    version = project["version"]

    for name, address in project["urls"].items():
        if ".invalid" in address:
            missing.blocking.append(
                f"The project has no address: set {name} in [project.urls] of pyproject.toml."
            )
    if not re.search(rf"^## {re.escape(version)} \(\d{{4}}-\d\d-\d\d\)$", changes, re.MULTILINE):
        missing.blocking.append(
            f"CHANGELOG.md has no date for {version}: write '## {version} (YYYY-MM-DD)'."
        )
    if citation["version"] != version:
        missing.blocking.append(f"CITATION.cff has version {citation['version']}: write {version}.")

    if not any("email" in author for author in project["authors"]):
        missing.later.append(
            "No author has an e-mail address: add one to authors in pyproject.toml."
        )
    if "doi" not in citation:
        missing.later.append("CITATION.cff has no DOI: Zenodo gives one with the first release.")
    if not all("orcid" in author for author in citation["authors"]):
        missing.later.append(
            "CITATION.cff names no people with an ORCID: JOSS and Zenodo ask for them."
        )
    if not all("affiliation" in author for author in paper["authors"]):
        missing.later.append("paper.md names no people with an affiliation: JOSS asks for them.")
    if not paper.get("date"):
        missing.later.append("paper.md has no date: write the day on which it is submitted.")
    return missing


def build(folder: Path) -> None:
    """The sdist, and the wheel that is built from it."""
    subprocess.run(
        [sys.executable, "-m", "uv", "build", "--quiet", "--out-dir", folder, ROOT], check=True
    )


def complaints(dist: Path) -> list[str]:
    """Complaints of the tools about the files in dist, a paragraph each; empty if all pass."""
    (sdist,) = dist.glob("*.tar.gz")
    (wheel,) = dist.glob("*.whl")
    files = {
        "twine": [sdist, wheel],
        "check-wheel-contents": [wheel],
        "cffconvert": [ROOT / "CITATION.cff"],
    }
    said = []
    for requirement, command in TOOLS.items():
        arguments = [*command, *map(str, files.get(command[0], [sdist]))]
        uv = [sys.executable, "-m", "uv", "tool", "run", "--quiet", "--from", requirement]
        done = subprocess.run([*uv, *arguments], capture_output=True, text=True, check=False)
        if done.returncode:
            said.append(
                f"{command[0]} refuses the files:\n{done.stdout.strip()}\n{done.stderr.strip()}"
            )
    return said


def main() -> int:
    """Print what is missing; 1 where it blocks a release, else 0."""
    missing = facts(ROOT)
    with tempfile.TemporaryDirectory() as folder:
        build(Path(folder))
        missing.blocking += complaints(Path(folder))
    for title, sentences in (
        ("Missing before a release", missing.blocking),
        ("Can follow it", missing.later),
    ):
        if sentences:
            print(f"{title}:", *(f"- {sentence}" for sentence in sentences), sep="\n")
    if not missing.blocking:
        print("Nothing blocks a release.")
    return 1 if missing.blocking else 0


if __name__ == "__main__":
    sys.exit(main())
