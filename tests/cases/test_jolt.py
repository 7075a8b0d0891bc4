"""Jolt, by JavaScript alone: results of another language are judged like those of any engine."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

from hcbench.cases.hcbench_cases import CASES
from hcbench.cases.score import read_scores

EXAMPLES = Path(__file__).parents[2] / "examples" / "cases"
EXAMPLE = EXAMPLES / "jolt.mjs"
NODE = Path(os.environ.get("HCBENCH_ENGINES", "none")) / "node"


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.mjs")), ids=lambda path: path.name)
def test_it_needs_at_most_63_lines(path: Path) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 63, "as docs/howto/cases.md says"


@pytest.mark.skipif(
    not (NODE / "node_modules" / "jolt-physics").is_dir(), reason="by `make test-engines`"
)
def test_it_passes_every_case(tmp_path: Path) -> None:
    shutil.copy(EXAMPLE, NODE)
    done = subprocess.run(
        ["node", EXAMPLE.name, str(CASES)], cwd=NODE, capture_output=True, text=True, check=True
    )
    (tmp_path / "jolt.json").write_text(done.stdout, encoding="utf-8")
    (found,) = read_scores(tmp_path / "jolt.json")
    assert [v["case"] for v in found.verdicts if v["verdict"] != "pass"] == [
        "C17",
        "C18",
    ]  # no mesh here
    assert found.restitution == "obeyed"
