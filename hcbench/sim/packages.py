"""Files that a URDF names by the ROS package they are in: package://NAME/meshes/foot.stl."""

from __future__ import annotations

import codecs
import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from hcbench.system.errors import SceneError, UserError
from hcbench.system.files import is_file, is_folder, read_bytes
from hcbench.system.text import sanitized, shown

Id = TypeVar("Id")

EXPAND_XACRO = "Expand it first: xacro robot.urdf.xacro > robot.urdf"
# An element of xacro: its namespace alone stays in a file that was expanded.
_XACRO = "<xacro:"
# The encoding that a file states in its first line.
_ENCODING = re.compile(rb"""^<\?xml[^>]*\bencoding\s*=\s*["']([\w.-]+)["']""")
_UTF16_MARKS = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
# Names that an error shows.
_LISTED = 12


def find_part(
    parts: Sequence[tuple[str, str, Id]],
    request: str,
    likely: Callable[[], Sequence[str]] = tuple,
) -> tuple[str, Id]:
    """Find the part of a model that a user names: its kind and id.

    parts: (kind, name, id) of each, such as ("geom", "plate", 0). Of several with the same name the
    first is meant.
    request: a name, or "KIND:NAME" or "KIND:ID" to say which; a part with just this name goes
    first.
    likely: gives names that users mean rather than others; called for an error alone.
    Raises UserError, with the names that there are, for one that no part has.
    """
    by_id: dict[str, tuple[str, Id]] = {}
    by_kind: dict[str, tuple[str, Id]] = {}
    by_name: dict[str, tuple[str, Id]] = {}
    # Backwards, so that the first of several parts with one name is meant.
    for kind, name, key in reversed(parts):
        by_id[f"{kind}:{key}"] = (kind, key)
        # As long as a request is kept: with its kind before it, a long name ends earlier.
        by_kind[sanitized(f"{kind}:{name}")] = (kind, key)
        by_name[name] = (kind, key)
    try:
        return (by_id | by_kind | by_name)[request]
    except KeyError:
        kinds = " or ".join(dict.fromkeys(kind for kind, _, _ in parts))
        known = likely() or [name for _, name, _ in parts]
        expected, advice = suggest_names(request, known)
        raise UserError("pair", f"no {kinds} {request!r}", expected, advice) from None


def suggest_names(request: str, names: Iterable[str]) -> tuple[str, str]:
    """Words for the error about a name that is not among `names`: (names expected, sentence).

    The sentence names the nearest one; "" where none is near.
    """
    known = list(dict.fromkeys(filter(None, names)))
    listed = known[:_LISTED]
    if len(known) > _LISTED:
        listed.append("...")
    expected = f"one of: {', '.join(listed) or 'none has a name'}"
    nearest = difflib.get_close_matches(request, known, 1)
    if not nearest:
        return expected, ""
    return expected, f"Did you mean {nearest[0]!r}?"


# (name, folder) of each.
Packages = tuple[tuple[str, str], ...]

_NAMED = re.compile(r"(?P<scheme>package|model)://(?P<name>[^/\"'<>]+)/(?P<rest>[^\"'<>]+)")
_FILE = re.compile(r"(?P<before>filename\s*=\s*)(?P<quote>[\"'])(?P<name>.*?)(?P=quote)")


def read_packages(given: str | Mapping[str, str]) -> Packages:
    """Parse "NAME=DIR, NAME=DIR", or a mapping, to (name, absolute folder).

    Raises UserError unless each name has a folder that exists.
    """
    packages = named_folders(given)
    for name, folder in packages:
        if not (name and folder and is_folder(folder)):
            got = name
            if folder:
                got += f"={folder}"
            raise UserError("package", repr(got), "NAME=DIR, with a folder that exists")
    return tuple((name, str(Path(folder).absolute())) for name, folder in packages)


def named_folders(given: str | Mapping[str, str]) -> Packages:
    """(name, folder) of each package, from a mapping or "NAME=FOLDER,..."; "" for what is missing.

    Folders need not exist.
    Raises UserError for what is neither text nor a mapping.
    """
    if isinstance(given, Mapping):
        return tuple((str(name), str(folder)) for name, folder in given.items())
    if not isinstance(given, str):
        raise UserError("package", shown(given), "NAME=DIR, or a table of folders by name")
    pairs = []
    for part in given.split(","):
        name, _, folder = part.partition("=")
        pairs.append((name.strip(), folder.strip()))
    return tuple(pairs)


def read_xml(path: Path) -> str:
    """The text of a model file, in the encoding that the file states; UTF-8 where it states none.

    Raises SceneError for other bytes, and OSError for a file that cannot be read.
    """
    content = read_bytes(path)
    encoding = "utf-8-sig"
    if content.startswith(_UTF16_MARKS):
        encoding = "utf-16"
    elif (stated := _ENCODING.match(content)) is not None and stated[1].lower() != b"utf-8":
        encoding = stated[1].decode()
    try:
        return content.decode(encoding)
    except (UnicodeError, LookupError) as error:
        got = f"{path} is not text in {encoding.removesuffix('-sig')}: {error}"
        expected = "XML in UTF-8, or in the encoding that its first line states"
        raise SceneError("model", got, expected) from None


def is_utf8(path: Path) -> bool:
    """Say whether a file is text in UTF-8, which engines read themselves."""
    try:
        read_bytes(path).decode()
    except UnicodeDecodeError:
        return False
    return True


def names_packages(urdf: str) -> bool:
    """Say whether a URDF names files by their packages."""
    return _NAMED.search(urdf) is not None


def require_expanded(path: Path, text: str) -> None:
    """Raise SceneError for a URDF that is still written in xacro."""
    if _XACRO in text:
        raise SceneError("model", f"{path} is written in xacro", "a URDF", EXPAND_XACRO)


def require_packages(path: Path, packages: Packages) -> None:
    """Raise SceneError for the first package of a URDF whose folder is not known, or lacks the
    file.

    packages: (name, folder) of those that the user gave.
    """
    folders = folders_of(path, packages)
    for match in _NAMED.finditer(read_xml(path)):
        name = match["name"]
        file = _as_text(match["rest"])
        if name not in folders:
            got = f"{path}: no folder above it has the files of package {name!r}"
            raise SceneError("model", got, "its folder", f"Give it by --package {name}=FOLDER")
        if not is_file(folders[name] / file):
            got = f"{path}: {match[0]!r} is not in {folders[name]}"
            raise SceneError("model", got, "a file of the package")


def folders_of(path: Path, packages: Packages) -> dict[str, Path]:
    """Folder of each package that a model file names after package:// or model://.

    It is the one given in `packages`, else the nearest above the file that has what is named.
    Packages that are in neither are left out.
    Raises SceneError for a file that is not text.
    """
    given = dict(packages)
    folders: dict[str, Path] = {}
    for match in _NAMED.finditer(read_xml(path)):
        name = match["name"]
        file = _as_text(match["rest"])
        if name in given:
            folders[name] = Path(given[name])
        elif name not in folders:
            for above in path.absolute().parents:
                if is_file(above / name / file):
                    folders[name] = above / name
                    break
    return folders


_ENTITIES = {"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&apos;"}
_ESCAPES = str.maketrans(_ENTITIES)


def _as_text(attribute: str) -> str:
    """The name that an attribute of XML has: "a&amp;b.stl" is a&b.stl.

    xml.sax.saxutils would import all that can open an address.
    """
    for letter, entity in reversed(_ENTITIES.items()):
        attribute = attribute.replace(entity, letter)
    return attribute


def with_absolute_files(path: Path, packages: Packages) -> str:
    """The text of a URDF with absolute names of all files that exist; other names stay.

    Raises SceneError for a file that is not text.
    """
    folders = folders_of(path, packages)

    def absolute(match: re.Match[str]) -> str:
        """The attribute with the absolute name of its file; as it is where there is no such file."""
        name = match["name"]
        # Folder of the file, None where its package is not known, and its path in there.
        folder: Path | None = path.absolute().parent
        file = _as_text(name)
        if (named := _NAMED.fullmatch(name)) is not None:
            folder = folders.get(named["name"])
            file = _as_text(named["rest"])
        written = name
        if folder is not None and is_file(folder / file):
            # The folders above may have a name such as "R&D".
            written = str((folder / file).resolve()).translate(_ESCAPES)
        return f"{match['before']}{match['quote']}{written}{match['quote']}"

    return _FILE.sub(absolute, read_xml(path))
