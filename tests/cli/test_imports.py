"""A command imports only the modules that it uses; imports take most of the time of a small one."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SLOW = {
    "numpy",
    "pint",
    "pydantic",
    "scipy.optimize",
    "scipy.special",
    "pandas",
    "matplotlib",
    "pyarrow",
    "mujoco",
}
MODEL = "scenes/steel-plane/scene.xml"

RUN = """
import contextlib, io, json, sys
from hcbench.cli import run
from hcbench.workers import mark_as_worker
mark_as_worker()  # what its worker process imports, too
with contextlib.redirect_stdout(io.StringIO()):
    code = run(sys.argv[1:])
print(json.dumps([code, list(sys.modules)]))
"""


@pytest.mark.parametrize(
    ("words", "uses"),
    [
        (["--help"], set()),
        (["tune", "--help"], set()),
        (["law", "--alpha", "0.008 s/in", "--speeds", "8 in/s"], {"numpy"}),
        (["convert", "--alpha", "0.008 s/in"], {"numpy", "pydantic"}),
        (["engines"], {"numpy", "pydantic"}),
        (["fit", "{table}"], {"numpy", "pydantic"}),
        (
            ["measure", MODEL, "--pair", "ball,plate", "--alpha", "0.3 s/m"],
            {"numpy", "pydantic", "mujoco"},
        ),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_a_command_imports_what_it_uses(words: list[str], uses: set[str], tmp_path: Path) -> None:
    table = tmp_path / "speeds.csv"
    table.write_text("v_in (m/s),v_out (m/s)\n0.2,0.19\n0.4,0.36\n0.8,0.64\n1.2,0.9\n")
    words = [word.format(table=table) for word in words]
    ran = subprocess.run(
        [sys.executable, "-c", RUN, *words], capture_output=True, text=True, check=True
    )
    code, modules = json.loads(ran.stdout)
    assert code == 0
    assert SLOW & set(modules) == uses
