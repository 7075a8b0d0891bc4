"""Files that a URDF names by the ROS package they are in: package://NAME/meshes/foot.stl."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from hcbench.system.errors import UserError
from hcbench.system.files import read_text

Packages = tuple[tuple[str, str], ...]  # (name, folder)

_NAMED = re.compile(r"(?P<scheme>package|model)://(?P<name>[^/\"'<>]+)/(?P<rest>[^\"'<>]+)")
_FILE = re.compile(r"(?P<before>filename\s*=\s*)(?P<quote>[\"'])(?P<name>.*?)(?P=quote)")


def read_packages(given: str | Mapping[str, str]) -> Packages:
    """Parse "NAME=DIR, NAME=DIR", or a mapping, to (name, absolute folder). UserError unless each
    folder exists.
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
    """Folder of each package that a model file names: as given, else the nearest above the file that has what
    is named. Packages that are in neither are left out.
    """
    given = dict(packages)
    folders: dict[str, Path] = {}
    for match in _NAMED.finditer(read_text(path)):
        name = match["name"]
        if name in given:
            folders[name] = Path(given[name])
        elif name not in folders:
            for above in path.absolute().parents:
                if (above / name / match["rest"]).is_file():
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
        shown = name if file is None or not file.is_file() else str(file.resolve())
        return f"{match['before']}{match['quote']}{shown}{match['quote']}"

    return _FILE.sub(absolute, read_text(path))
