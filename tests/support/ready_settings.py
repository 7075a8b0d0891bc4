"""Settings that recipes searched for, ready for tests that check no search.

`python tests/support/ready_settings.py` searches again and writes them.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

from hcbench.terms.setting import Setting
from hcbench.testing import setting_for as search

_FILE = Path(__file__).with_suffix(".json")
SEARCHES = (
    ("mujoco.soft", "steel-cup"),
    ("mujoco.soft", "steel-plane"),
    ("mujoco.staggered-push", "steel-cup"),
    ("mujoco.staggered-push", "steel-plane"),
    ("mujoco.two-pair", "steel-plane"),
    ("pybullet.staggered", "steel-plane"),
)  # recipe and scene of those that take longer than a second


@cache
def _settings() -> dict[tuple[str, str], Setting]:
    records: list[dict[str, Any]] = json.loads(_FILE.read_text(encoding="utf-8"))
    return dict(zip(SEARCHES, (Setting(**record) for record in records), strict=True))


def ready_setting(recipe: str, scene: str) -> Setting:
    """The setting that `hcbench.testing.setting_for` finds, read from
    the file where it would search.
    """
    return _settings().get((recipe, scene)) or search(recipe, scene)


def write() -> None:
    """Search for every setting of the file."""
    records = [asdict(search(*each)) for each in SEARCHES]
    _FILE.write_text(json.dumps(records, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write()
