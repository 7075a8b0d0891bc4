"""Settings that searches found, kept in the user's cache folder: the same search is not made twice.

A setting is kept by all that it depends on: the target, the recipe, this package's files, and
the versions of the engine and of what computes. Where the folder cannot be written to, by
this user alone, or a file in it is not whole, the search is made: what a recipe gives is the
same with the folder and without.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from hcbench.system.compiler import is_private
from hcbench.system.files import read_text, replace_file, user_folder
from hcbench.terms.setting import Setting

if TYPE_CHECKING:
    from hcbench.recipes.recipe import Recipe
    from hcbench.recipes.target import Target

_PACKAGE = Path(__file__).parents[1]
# A search that takes less of a processor's time, s, is quicker made than read.
_WORTH_S = 0.05
# Time since a setting was found, s, from which it is removed.
_OLD_S = 90 * 86400.0


def place_of(recipe: Recipe, target: Target, versions: Mapping[str, str]) -> Path | None:
    """Path of the file in the cache that keeps the setting for a target; it need not exist.

    versions: of the engine and of the libraries that compute, by name.
    None for a recipe from outside its engine's folder in this package, as its code is not part of
    the file's name, and where there is no cache folder.
    """
    folder = recipe.engine.replace("-", "_")
    if not f"{recipe.function.__module__}.".startswith(f"hcbench.engines.{folder}."):
        return None
    about = (
        recipe.engine,
        recipe.name,
        target,
        sorted(versions.items()),
        sys.version,
        platform.machine(),
    )
    with suppress(OSError, RuntimeError):
        return user_folder("cache") / "searches" / f"{_digest(repr((about, _code())))}.json"
    return None


def kept(recipe: Recipe, target: Target, place: Path | None) -> Setting | None:
    """Read the kept setting of a recipe for a target; None without one, and for a file that is old
    or not whole, or whose folder other users can write to.

    place: path of the file, as `place_of` returns it.
    """
    if place is None:
        return None
    with suppress(OSError, ValueError):
        if place.is_file() and is_private(place.parent) and not _is_old(place):
            # A digest on the first line, then the options as JSON, of which it is.
            digest, _, text = read_text(place).partition("\n")
            if digest == _digest(text):
                return Setting(recipe.engine, recipe.name, target.timestep, json.loads(text))
    return None


def make(recipe: Recipe, target: Target, place: Path | None) -> Setting:
    """Make the setting of a recipe for a target, and keep it in a file if that took long; files
    that are old are deleted then.

    place: path of the file, None to keep nothing. Where the file cannot be written nothing is
    kept, without an error.
    Raises what the recipe raises.
    """
    began = time.process_time()
    setting = recipe(target)
    took = time.process_time() - began
    text = json.dumps(setting.options)
    # Options that JSON would change, such as tuples, are not kept: they would come back otherwise.
    if place is not None and took >= _WORTH_S and json.loads(text) == setting.options:
        with suppress(OSError):
            if is_private(place.parent):
                replace_file(place, f"{_digest(text)}\n{text}".encode())
                for old in filter(_is_old, place.parent.iterdir()):
                    old.unlink()
    return setting


def _is_old(file: Path) -> bool:
    return time.time() - file.stat().st_mtime > _OLD_S


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


@lru_cache(maxsize=1)
def _code() -> str:
    """A digest of where this package is, and of the name, time and size of each file of its code."""
    return _digest(repr((str(_PACKAGE), sorted(_files(str(_PACKAGE))))))


def _files(folder: str) -> Iterator[tuple[str, int, int]]:
    """Yield (path, time of change in ns, size in bytes) of every file of code below a folder.

    Raises OSError for a folder that cannot be read.
    """
    with os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_dir():
                yield from _files(entry.path)
            elif entry.name.endswith((".py", ".c", ".h")):
                status = entry.stat()
                yield entry.path, status.st_mtime_ns, status.st_size
