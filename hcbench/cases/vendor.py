"""Copies the runner, chosen cases and a test into a folder of an engine's own repository."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from hcbench.cases import make
from hcbench.cases.score import the_cases
from hcbench.system.errors import OutputError, UserError
from hcbench.system.files import read_text
from hcbench.system.outputs import require_outputs, write_output
from hcbench.system.text import sanitized

_HERE = Path(__file__).parent
# An adapter to begin with: each world is one that the engine cannot make yet.
ADAPTER = '''\
"""The engine behind hcbench_cases.py."""


class Engine:
    name, version, combine = "mine", "0", None

    def make(self, world):
        raise NotImplementedError("is not adapted yet")

    def step(self):
        pass

    def state(self):
        return []


ENGINES = [Engine]
'''


def vendor(folder: Path, only: Sequence[str] = (), force: bool = False) -> list[Path]:
    """Write a folder that needs nothing but Python's standard library, and return its files.

    only: ids of the cases; all where it is empty. An adapter that is there already stays.
    force: replace files that `vendor` did not write, or that were changed since.
    Raises UserError for an unknown case, for a `folder` that is a file, and for such a file, unless
    force is set; OutputError for one that cannot be written. Nothing is written then.
    """
    chosen = [case["id"] for case in the_cases(only)["cases"]]
    if folder.exists() and not folder.is_dir():
        raise UserError("FOLDER", f"{folder} is a file", "a folder")
    contents = {
        "hcbench_cases.py": read_text(_HERE / "hcbench_cases.py"),
        make.FILE.name: make.text(chosen),
        "test_hcbench_cases.py": read_text(_HERE / "vendored_test.py"),
    }
    if not (folder / "adapter.py").exists():
        contents["adapter.py"] = ADAPTER
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        got = f"{sanitized(folder)}: {error.strerror}"
        raise OutputError("FOLDER", got, "a folder that can be made") from None
    # None is written where one of them is in the way.
    for name in contents:
        require_outputs({"FOLDER": folder / name}, force=force)
    for name, text in contents.items():
        write_output(folder / name, text, "FOLDER", force)
    return [folder / name for name in contents]
