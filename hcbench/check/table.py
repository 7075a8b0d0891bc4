"""Checks listed in a file: `[tool.hcbench]` of a pyproject.toml, or the same in any TOML file.

[tool.hcbench]              # what all checks share
max-error = 0.02
speeds = "0.1:1:5 m/s"

[[tool.hcbench.check]]
name = "ball on plate"
model = "models/ball.xml"   # or a list of two; paths start at the file's own folder
pair = "ball,plate"
restitution = 0.9           # or alpha, pairs (a CSV), baseline
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ConfigDict, Field

from hcbench._text import sanitized
from hcbench.check.plan import Ask, plan
from hcbench.errors import UserError
from hcbench.fields import Table, read_toml, validate

if TYPE_CHECKING:
    from hcbench.check.model import Check

Quantity = float | str
Quantities = float | str | list[float | str]


def _hyphens(name: str) -> str:
    return name.replace("_", "-")


class _Shared(Table):
    model_config = ConfigDict(alias_generator=_hyphens, populate_by_name=True)

    max_error: float | None = None
    speeds: Quantities | None = None
    phases: int | list[float] | None = None
    timestep: Quantity | None = None
    gravity: Quantity | list[float] | None = None
    key: str | None = None
    height: Quantity | None = None
    engine: str | None = None
    limit: Quantity | None = None


class _Entry(_Shared):
    model: str | list[str]
    name: str | None = None
    pair: str | list[str] | None = None
    alpha: Quantity | None = None
    reading: str = "law"
    restitution: float | None = None
    pairs: str | None = None
    baseline: str | None = None


class _Checks(_Shared):
    check: list[_Entry] = Field(min_length=1)


def find_table(path: Path) -> dict[str, Any] | None:
    """The table of a TOML file: [tool.hcbench], or all of a file that has [[check]]; None without one."""
    content = read_toml(path, UserError, "checks")
    table = content.get("tool", {}).get("hcbench") if isinstance(content.get("tool"), dict) else None
    if table is None and "check" in content:
        table = content
    return table


def checks_of(path: Path, baseline: Path | None = None) -> list[Check]:
    """The checks a file lists; UserError names the entry and key that cannot be used.

    baseline: a file to hold all of them against, instead of what they say.
    """
    table = find_table(path)
    if table is None:
        raise UserError(
            "checks", f"{path} has no [tool.hcbench]", "a table with [[tool.hcbench.check]] entries"
        )
    parsed = validate(_Checks, table, UserError, f"checks: {path}: [tool.hcbench] {{}}")
    shared = parsed.model_dump(exclude={"check"}, exclude_none=True)
    checks = []
    for entry in parsed.check:
        given = {**shared, **entry.model_dump(exclude_none=True)}
        if baseline is not None:
            given = {k: v for k, v in given.items() if k not in ("alpha", "restitution", "pairs")}
        checks.append(plan(_ask(given, path.parent, baseline)))
    names = [check.name for check in checks]
    for name in names:
        if names.count(name) > 1:
            raise UserError("checks", f"{path}: two checks are called {sanitized(name)!r}", "a name for each")
    return checks


def _ask(given: dict[str, Any], folder: Path, baseline: Path | None) -> Ask:
    model = given.pop("model")
    models = [model] if isinstance(model, str) else model
    for key in ("pairs", "baseline"):
        if key in given:
            given[key] = folder / given[key]
    if baseline is not None:
        given["baseline"] = baseline
    return Ask(models=tuple(str(folder / part) for part in models), **given)
