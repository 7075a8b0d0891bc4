"""The C of the laws and plug-ins under every compiler of this machine:
no warning, no private symbol.

`make test-compilers` takes every version of gcc and clang that has a name of its own on PATH, and
the wheels of MuJoCo unpacked in the folders of $HCBENCH_MUJOCOS, beside the installed one.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from hcbench.engines.mujoco import plugin as mujoco_plugin
from hcbench.engines.pybullet import plugin as pybullet_plugin
from hcbench.system import compiler as _compile

STRICT = ("-Werror", "-Wall", "-Wextra", "-Wimplicit-function-declaration")
PACKAGE = Path(_compile.__file__).parents[1]
INSTALLED = Path(mujoco.__file__).parent
ALL_VERSIONS = "HCBENCH_MUJOCOS" in os.environ  # make test-compilers
MUJOCOS = [
    INSTALLED,
    *map(Path, filter(None, os.environ.get("HCBENCH_MUJOCOS", "").split(os.pathsep))),
]


def _compilers() -> list[list[str]]:
    numbered = [f"{name}-{version}" for name in ("gcc", "clang") for version in range(9, 30)]
    names = ["gcc", "clang", *(numbered if ALL_VERSIONS else [])]
    return [[name] for name in names if shutil.which(name)] + [
        [sys.executable, "-m", "ziglang", "cc"]
    ]


def _name(command: list[str]) -> str:
    return command[0] if len(command) == 1 else "zig"


def _compiled(command: list[str], source: str, out: Path, flags: list[str], link: list[str]) -> str:
    # The front end of clang, which zig has too, says all that it warns of; gcc's optimizer warns.
    is_gcc = command[0].startswith("gcc")
    words = [
        *command,
        *_compile.FLAGS,
        *(() if is_gcc or ALL_VERSIONS else ("-O0",)),
        *STRICT,
        *flags,
        "-o",
        str(out),
        str(PACKAGE / source),
        *link,
        "-lm",
    ]
    environment = _compile.environment(str(out.parent))
    return subprocess.run(
        words, capture_output=True, text=True, check=False, env=environment
    ).stderr


@pytest.mark.parametrize("command", _compilers(), ids=_name)
@pytest.mark.parametrize("folder", MUJOCOS, ids=lambda folder: folder.parent.name)
def test_mujocos_plug_in_compiles_without_a_warning(
    command: list[str], folder: Path, tmp_path: Path
) -> None:
    flags, link, _ = mujoco_plugin.compiler_arguments(folder)
    assert _compiled(command, mujoco_plugin.SOURCE, tmp_path / "built.so", flags, link) == ""


@pytest.mark.parametrize("command", _compilers(), ids=_name)
@pytest.mark.parametrize("source", ["laws/impacts.c", pybullet_plugin.SOURCE])
def test_laws_and_bullets_plug_in_compile_without_a_warning(
    command: list[str], source: str, tmp_path: Path
) -> None:
    link = pybullet_plugin.LINK if source == pybullet_plugin.SOURCE else []
    assert _compiled(command, source, tmp_path / "built.so", [], link) == ""


@pytest.mark.parametrize("folder", MUJOCOS, ids=lambda folder: folder.parent.name)
def test_only_functions_of_mujocos_public_headers_are_called(folder: Path) -> None:
    headers = "".join(
        path.read_text(encoding="utf-8") for path in sorted((folder / "include/mujoco").glob("*.h"))
    )
    public = set(re.findall(r"^MJAPI\s[^;]*?\b(mj\w+)\(", headers, re.MULTILINE))
    public |= set(re.findall(r"^#define (mj\w+)\(", headers, re.MULTILINE))
    sources = sorted((PACKAGE / mujoco_plugin.SOURCE).parent.glob("*.c"))
    code = "".join(path.read_text(encoding="utf-8") for path in sources)
    called = set(re.findall(r"\b(mj[a-z]*_\w+)\(", re.sub(r"/\*.*?\*/", "", code, flags=re.DOTALL)))
    assert len(called) > 20
    assert called <= public
