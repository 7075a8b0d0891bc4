"""Addresses and documentation of the project, to which a page or a help text can send a reader."""

from __future__ import annotations

from pathlib import Path

PURPOSE = (
    "hcbench measures how physics engines bounce, and finds what to write so that they bounce like"
    " your material."
)
_PACKAGE = Path(__file__).parents[1]
# The repository, where the package runs from a clone: else a folder without these.
CLONE = _PACKAGE.parent
# Markdown of the documentation: in a clone, or in the installed package.
DOCUMENTATION = (CLONE / "docs", _PACKAGE / "data" / "docs")
# Top-level domain of an address that was not set, which nobody can own (RFC 2606).
_UNSET = ".invalid"


def address(name: str) -> str:
    """An address of [project.urls] in pyproject.toml, its only place; "" while it is not set.

    name: Source or Documentation.
    """
    # Half of the time of `hcbench --help` would be this import.
    from importlib.metadata import metadata

    for line in metadata("hcbench").get_all("Project-URL", []):
        title, url = line.split(", ", 1)
        if title == name and _UNSET not in url:
            return str(url).rstrip("/")
    return ""


def install_line() -> str:
    """The command that installs hcbench: from its source, once that has an address; else from a clone."""
    source = address("Source")
    if source:
        return f"pip install git+{source}"
    return "pip install ."
