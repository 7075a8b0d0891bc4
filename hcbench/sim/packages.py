"""Files that a URDF names by the ROS package they are in: package://NAME/meshes/foot.stl."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from hcbench.system.errors import UserError
from hcbench.system.files import is_file, read_text

Id = TypeVar("Id")

EXPAND_XACRO = "Expand it first: xacro robot.urdf.xacro > robot.urdf"
# Names that an error shows.
_LISTED = 12


def find_part(parts: Sequence[tuple[str, str, Id]], request: str) -> tuple[str, Id]:
    """(kind, id) of the part that a user names.

    parts: (kind, name, id) of each, such as ("geom", "plate", 0). Of several with the same name the first is
        meant.
    request: a name, or "KIND:NAME" or "KIND:ID" to say which.
    Raises UserError with the names there are.
    """
    by_id: dict[str, tuple[str, Id]] = {}
    by_kind: dict[str, tuple[str, Id]] = {}
    by_name: dict[str, tuple[str, Id]] = {}
    # Backwards, so that the first of several parts with one name is meant.
    for kind, name, key in reversed(parts):
        by_id[f"{kind}:{key}"] = (kind, key)
        by_kind[f"{kind}:{name}"] = (kind, key)
        by_name[name] = (kind, key)
    try:
        return (by_id | by_kind | by_name)[request]
    except KeyError:
        kinds = " or ".join(dict.fromkeys(kind for kind, _, _ in parts))
        expected, advice = suggest_names(request, (name for _, name, _ in parts))
        raise UserError("pair", f"no {kinds} {request!r}", expected, advice) from None


def suggest_names(request: str, names: Iterable[str]) -> tuple[str, str]:
    """For a name that is not among `names`: (the names expected, a sentence with
    the nearest one), for an error.
    """
    known = list(dict.fromkeys(filter(None, names)))
    listed = known if len(known) <= _LISTED else [*known[:_LISTED], "..."]
    nearest = difflib.get_close_matches(request, known, 1)
    return f"one of: {', '.join(listed) or 'none has a name'}", (
        f"Did you mean {nearest[0]!r}?" if nearest else ""
    )


# (name, folder) of each.
Packages = tuple[tuple[str, str], ...]

_NAMED = re.compile(r"(?P<scheme>package|model)://(?P<name>[^/\"'<>]+)/(?P<rest>[^\"'<>]+)")
_FILE = re.compile(r"(?P<before>filename\s*=\s*)(?P<quote>[\"'])(?P<name>.*?)(?P=quote)")


def read_packages(given: str | Mapping[str, str]) -> Packages:
    """Parse "NAME=DIR, NAME=DIR", or a mapping, to (name, absolute folder).
    UserError unless each folder exists.
    """
    packages = named_folders(given)
    for name, folder in packages:
        if not (name and folder and Path(folder).is_dir()):
            got = f"{name}={folder}" if folder else name
            raise UserError("package", repr(got), "NAME=DIR, with a folder that exists")
    return tuple((name, str(Path(folder).absolute())) for name, folder in packages)


def named_folders(given: str | Mapping[str, str]) -> Packages:
    """(name, folder) of each package, from a mapping or "NAME=FOLDER,..."; "" for what is missing."""
    if not isinstance(given, str):
        return tuple((str(name), str(folder)) for name, folder in given.items())
    pairs = []
    for part in given.split(","):
        name, _, folder = part.partition("=")
        pairs.append((name.strip(), folder.strip()))
    return tuple(pairs)


def folders_of(path: Path, packages: Packages) -> dict[str, Path]:
    """Folder of each package that a model file names: as given, else the nearest above the file
    that has what is named. Packages that are in neither are left out.
    """
    given = dict(packages)
    folders: dict[str, Path] = {}
    for match in _NAMED.finditer(read_text(path)):
        name = match["name"]
        if name in given:
            folders[name] = Path(given[name])
        elif name not in folders:
            for above in path.absolute().parents:
                if is_file(above / name / match["rest"]):
                    folders[name] = above / name
                    break
    return folders


def with_absolute_files(path: Path, packages: Packages) -> str:
    """The text of a URDF with absolute names of all files that exist."""
    folders = folders_of(path, packages)

    def absolute(match: re.Match[str]) -> str:
        name = match["name"]
        if (named := _NAMED.fullmatch(name)) is not None:
            folder = folders.get(named["name"])
            file = None if folder is None else folder / named["rest"]
        else:
            file = path.absolute().parent / name
        shown = name if file is None or not is_file(file) else str(file.resolve())
        return f"{match['before']}{match['quote']}{shown}{match['quote']}"

    return _FILE.sub(absolute, read_text(path))
