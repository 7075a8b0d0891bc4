"""The cache of compiled laws: what is in it is loaded only as it was compiled, by us."""

from __future__ import annotations

import ctypes
import errno
import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from hcbench.system import compiler as _compile
from hcbench.system.errors import UserError


@pytest.fixture(scope="module", autouse=True)
def _without_optimization() -> Iterator[None]:
    """Libraries that are compiled in a sixth of the time: what they compute is tested elsewhere."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_compile, "FLAGS", (*_compile.FLAGS, "-O0"))
        yield


@pytest.fixture(scope="module")
def compiled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the library in it."""
    folder = tmp_path_factory.mktemp("compiled")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HCBENCH_CACHE", str(folder))
        _compile.build("laws/impacts.c")
    return folder


@pytest.fixture
def library(compiled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(compiled, tmp_path, dirs_exist_ok=True)
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path))
    return _compile.build("laws/impacts.c")


def cut(library: Path) -> None:
    library.write_bytes(library.read_bytes()[:4096])


def empty(library: Path) -> None:
    library.write_bytes(b"")


def edited(library: Path) -> None:
    content = bytearray(library.read_bytes())
    content[len(content) // 2] ^= 1
    library.write_bytes(content)


def writable_by_others(library: Path) -> None:
    library.chmod(0o777)


def linked(library: Path) -> None:
    library.rename(library.with_name("elsewhere.so"))
    library.symlink_to("elsewhere.so")


def without_digest(library: Path) -> None:
    library.with_suffix(".sha256").unlink()


@pytest.mark.parametrize(
    "damage",
    [cut, empty, edited, writable_by_others, linked, without_digest],
    ids=lambda d: d.__name__,
)
def test_a_library_that_is_not_as_it_was_compiled_is_compiled_again(
    library: Path, damage: Callable[[Path], None]
) -> None:
    """A cut one ended the process by SIGBUS."""
    assert _compile.is_whole(library)
    damage(library)
    assert not _compile.is_whole(library)
    assert _compile.build("laws/impacts.c") == library
    assert _compile.is_whole(library)
    assert not library.is_symlink()
    assert ctypes.CDLL(str(library)).hcb_advance


def test_a_whole_library_is_not_compiled_again(library: Path) -> None:
    before = library.stat()
    assert _compile.build("laws/impacts.c") == library
    assert library.stat().st_ino == before.st_ino
    assert not [path for path in library.parent.iterdir() if path.suffix not in (".so", ".sha256")]


@pytest.mark.skipif(not hasattr(os, "getuid"), reason="no owners of files")
def test_a_library_of_another_user_is_not_loaded(
    library: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    uid = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: uid + 1)
    assert not _compile.is_whole(library)


SLOW = """#!/bin/sh
touch "$TMPDIR/left-behind.s"
sleep 600 &
echo $! > {pid}
wait
"""


def _runs(process: str) -> bool:
    """Say whether a process has not ended; one that its parent has not yet asked for has."""
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="no groups of processes")
def test_an_interrupted_compiler_leaves_no_process_and_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Like gcc, the compiler runs another program, and leaves its temporary files when killed."""
    cache, pid, compiler = tmp_path / "cache", tmp_path / "pid", tmp_path / "cc"
    compiler.write_text(SLOW.format(pid=pid))
    compiler.chmod(0o755)
    monkeypatch.setenv("HCBENCH_CACHE", str(cache))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("CC", str(compiler))
    monkeypatch.setattr(_compile, "_LIMIT_S", 1.0)
    with pytest.raises(_compile.NotCompiled, match="cc ran for 1 s"):
        _compile.build("laws/impacts.c")
    # A busy machine gives a killed process its last turn later.
    for _ in range(100):
        if not _runs(pid.read_text().strip()):
            break
        time.sleep(0.1)
    assert not _runs(pid.read_text().strip())
    assert not [path for path in cache.rglob("*") if path.name != "hcbench"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "cc", "pid"]


def test_a_full_disk_is_not_answered_with_a_compiler(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiler = tmp_path / "cc"
    compiler.write_text(
        f"#!/bin/sh\necho 'ld: final link failed: {os.strerror(errno.ENOSPC)}' >&2\nexit 1\n"
    )
    compiler.chmod(0o755)
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(_compile.NotCompiled, match="expected room for the library") as caught:
        _compile.build("laws/impacts.c")
    assert "plugin" not in str(caught.value).partition(":")[2]


@pytest.mark.parametrize("options", ["-E", "-c", "-S"])
def test_a_compiler_that_writes_no_library_is_named_and_its_file_is_not_kept(
    options: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HCBENCH_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", f"cc {options}")
    with pytest.raises(_compile.NotCompiled, match=f"CC=cc {options} wrote .* not load"):
        _compile.build("laws/impacts.c")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


@pytest.mark.parametrize("named", [" ", "''", "'"])
def test_a_cc_that_names_no_compiler_is_refused(
    named: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", named)
    with pytest.raises(UserError, match=r"^\$CC: .*CC=gcc"):
        _compile.compiler()
