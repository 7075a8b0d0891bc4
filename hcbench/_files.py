"""Files written whole or not at all, and folders that know what an earlier run wrote into them."""

from __future__ import annotations

import errno
import hashlib
import json
import math
import os
import shutil
import signal
import tempfile
import threading
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.errors import HcbenchError, OutputError, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator

MANIFEST = "hcbench-files.json"
_FILLED = "hcbench files"


def json_text(content: Any) -> str:
    """JSON, stable, with null for what is not a finite number."""
    return json.dumps(_no_nan(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _no_nan(content: Any) -> Any:
    if isinstance(content, dict):
        return {k: _no_nan(v) for k, v in content.items()}
    if isinstance(content, list | tuple):
        return [_no_nan(v) for v in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: into a neighbour first, then renamed."""
    try:
        handle, neighbour = tempfile.mkstemp(prefix=".hcbench-", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            mask = os.umask(0)
            os.umask(mask)
            Path(neighbour).chmod(0o666 & ~mask)  # mkstemp makes it private
            Path(neighbour).replace(path)
        except BaseException:
            Path(neighbour).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise _unwritable("output", path, error, "a place that can be written to") from None


def _unwritable(slot: str, path: Path, error: OSError, expected: str) -> HcbenchError:
    """Whose fault it is: a name that no disk takes is the user's, a full disk is not."""
    if error.errno == errno.ENAMETOOLONG:
        return UserError(slot, f"{str(path)[:80]}...: {error.strerror}", "a shorter path")
    return OutputError(slot, f"{path}: {error.strerror}", expected)


@contextmanager
def filled_folder(folder: Path) -> Iterator[Path]:
    """A scratch folder whose files move into `folder` when the block ends well; else nothing is left.

    Files of an earlier filling that are not of this one go, unless someone has changed them since: MANIFEST
    lists what was written, with a digest of each.
    """
    made: list[Path] = []
    try:
        made = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".hcbench-", dir=folder))
    except OSError as error:
        raise _unwritable("output folder", folder, error, "a folder that can be written to") from None
    try:
        yield scratch
        with undisturbed():
            _move(scratch, folder)
    except BaseException as error:
        shutil.rmtree(scratch, ignore_errors=True)
        for path in made:
            if path.exists() and not any(path.iterdir()):
                path.rmdir()
        if isinstance(error, OSError):
            raise _unwritable("output folder", folder, error, "a folder that can be written to") from None
        raise
    shutil.rmtree(scratch, ignore_errors=True)


def _move(scratch: Path, folder: Path) -> None:
    earlier = _listed(folder)
    (scratch / MANIFEST).unlink(missing_ok=True)  # of a filling within this one
    items = [item for item in sorted(scratch.rglob("*")) if item.is_file()]
    own = {item.relative_to(scratch).as_posix(): _digest(item) for item in items}
    # Listed before they are there: however this ends, the next filling knows what is not someone else's.
    write_text(folder / MANIFEST, json_text({"schema": 1, "kind": _FILLED, "files": {**earlier, **own}}))
    for item in items:
        target = folder / item.relative_to(scratch)
        target.parent.mkdir(parents=True, exist_ok=True)
        item.replace(target)
    for name in earlier.keys() - own.keys():
        stale = folder / name
        if stale.is_file() and not stale.is_symlink() and _digest(stale) == earlier[name]:
            stale.unlink()
            if stale.parent != folder and not any(stale.parent.iterdir()):
                stale.parent.rmdir()
    write_text(folder / MANIFEST, json_text({"schema": 1, "kind": _FILLED, "files": own}))


def _listed(folder: Path) -> dict[str, str]:
    """Files below `folder` that an earlier filling wrote, and their digests; none where nothing says so."""
    try:
        content = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        files = content["files"] if content["kind"] == _FILLED else {}
        below = {str(name): str(digest) for name, digest in files.items()}
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return {}
    return {n: d for n, d in below.items() if not Path(n).is_absolute() and ".." not in Path(n).parts}


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ctrl-C and its kin wait until the block is through; for moments, in the main thread."""
    came: list[int] = []
    kept: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for name in ("SIGINT", "SIGTERM", "SIGHUP"):
            number = getattr(signal, name, None)
            if number is not None and callable(signal.getsignal(number)):
                kept[number] = signal.signal(number, lambda n, _: came.append(n))
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
    for number in came[:1]:
        signal.raise_signal(number)
