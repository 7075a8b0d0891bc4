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

from collections import Counter
from pathlib import Path
from typing import Any

from pydantic import Field

from hcbench.checking.spec import Check, CheckSpec, SharedSpec, plan
from hcbench.sim.packages import named_folders
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized
from hcbench.terms.fields import read_toml, validate


class CheckTable(SharedSpec):
    """The table: what all checks share, and the checks."""

    check: list[CheckSpec] = Field(min_length=1)


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
    content = find_table(path)
    if content is None:
        raise UserError(
            "checks", f"{path} has no [tool.hcbench]", "a table with [[tool.hcbench.check]] entries"
        )
    table = validate(CheckTable, content, UserError, f"checks: {path}: [tool.hcbench] {{}}")
    checks = [plan(_complete(entry, table, path.parent, baseline)) for entry in table.check]
    name, count = Counter(check.name for check in checks).most_common(1)[0]
    if count > 1:
        raise UserError("checks", f"{path}: two checks are called {sanitized(name)!r}", "a name for each")
    return checks


def _complete(entry: CheckSpec, table: CheckTable, folder: Path, baseline: Path | None) -> CheckSpec:
    """An entry with what the table says for all of them, and with paths from its folder."""
    shared = {name: getattr(table, name) for name in SharedSpec.model_fields.keys() - entry.model_fields_set}
    paths: dict[str, Any] = {
        name: folder / path for name in ("pairs", "baseline", "trajectory") if (path := getattr(entry, name))
    }
    if package := entry.launch["package"] or table.launch["package"]:
        paths["package"] = {name: str(folder / path) for name, path in named_folders(package)}
    if not entry.models:
        raise UserError("model", "none given", "a file, or two URDF files")
    models = {"model": tuple(str(folder / model) for model in entry.models)}
    instead = dict.fromkeys(("alpha", "restitution", "pairs")) | {"baseline": baseline} if baseline else {}
    return entry.model_copy(update={**shared, **paths, **models, **instead})
