"""Output files that a user names: they never replace an input, nor a
file that hcbench did not write.

A mark near the end of each says which option wrote it, with a digest of all else in the file. A
file without its mark, or changed since, is replaced only if it is empty, or with --force; devices
and pipes are written through.
"""

from __future__ import annotations

import errno
import hashlib
import itertools
import json
import os
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path

from hcbench.system.errors import OutputError, UserError
from hcbench.system.files import read_bytes, standard_stream, write_bytes
from hcbench.system.text import sanitized

# Bytes at the end of a file that are searched for the mark: what follows it is shorter.
_TAIL = 4096
_PNG = b"\x89PNG\r\n\x1a\n"
_ZIP = b"PK\x03\x04"
# A last key in the last object of a JSON file has its mark.
MARK_KEY = "mark"
# The end of a JSON object, or of a list of objects.
_JSON_END = re.compile(rb"\s*\}\s*\]?\s*\Z")
_QUOTED = re.compile(rb"[\"']([^\"'\n]{1,255})[\"']")
# Input files that are searched for the names of further ones, at most.
_MOST_NAMED = 1000
_TEXTS = {".xml", ".mjcf", ".urdf", ".sdf", ".toml", ".json", ".py", ".csv"}


def write_output(path: Path, content: str | bytes, option: str, force: bool = False) -> None:
    """Write an output with its mark, whole or not at all, or through a device or a pipe.

    option: the option that names it, such as "--page".
    force: replace any file.
    Raises UserError where a file is in the way that the same option did not write, and for a path
    at which no file can be; OutputError where it cannot be written; ValueError for JSON that has no
    place for a mark.
    """
    _require_replaceable(path, option, force)
    if isinstance(content, str):
        content = content.encode()
    write_bytes(path, _marked(content, option), option)


def require_outputs(
    outputs: Mapping[str, Path], inputs: Iterable[object] = (), force: bool = False
) -> None:
    """Raise what `write_output` would, before anything is computed.

    outputs: files, by the options that name them.
    inputs: arguments of any type. Those that name files or folders, or functions of Python files,
        are read. What these name in quotes, such as meshes, is an input too.
    force: other files may be replaced, but never an input.
    Raises UserError also for an output that is an input, a folder or in none, a circle of links, or
    the file of another option; OutputError for a missing permission.
    """
    read = list(_existing(list(inputs)))
    # By its file, the option that came first.
    seen: dict[Path, str] = {}
    for option, path in outputs.items():
        if _leads_to_itself(path):
            raise UserError(
                option, f"{sanitized(path)} is a link that leads back to itself", "a file"
            )
        other = seen.setdefault(path.resolve(), option)
        if other != option and not _is_stream(path):
            got = f"{sanitized(path)} is the file of {other} too"
            raise UserError(option, got, "a file of its own")
        _require_output(path, option, read, force)


def _leads_to_itself(path: Path) -> bool:
    """Say whether a path leads through links in a circle; False for any other error."""
    try:
        path.stat()
    except OSError as error:
        return error.errno == errno.ELOOP
    return False


def _is_stream(path: Path) -> bool:
    return path.exists() and not path.is_file()


def _without_function(name: str) -> str:
    """The file of a name: FILE.py of "FILE.py:FUNCTION"."""
    stem, colon, _ = name.partition(".py:")
    if colon:
        return f"{stem}.py"
    return name


def _existing(value: object) -> Iterator[Path]:
    """Files and folders that an argument names, or several arguments; those that do not exist, and
    arguments that name nothing, are passed over.
    """
    if isinstance(value, tuple | list):
        for part in value:
            yield from _existing(part)
    elif isinstance(value, str | Path):
        path = Path(_without_function(str(value)))
        if _is(path, Path.exists):
            yield path


def _require_output(path: Path, option: str, inputs: Iterable[Path], force: bool) -> None:
    """Raise UserError for an output that is a folder or in none, that is an input, or that would
    replace a file which the option did not write; OutputError for a missing permission.

    path: of the output.
    option: the one that names it.
    inputs: files and folders that exist; files that their texts name in quotes are inputs, too.
    force: a file of another option may be replaced.
    """
    shown = sanitized(path)
    folder = path.absolute().parent
    if path.is_dir():
        raise UserError(option, f"{shown} is a folder", "a file in an existing folder")
    if not folder.is_dir():
        got = f"{shown} is in a folder that does not exist"
        raise UserError(option, got, "a file in an existing folder")
    if path.exists() and any(_is_same(path, each) for each in _all_inputs(inputs)):
        raise UserError(option, f"{shown} is an input", "another file", "Inputs are never replaced")
    replaced = folder
    if path.exists():
        replaced = path
    if not os.access(replaced, os.W_OK):
        raise OutputError(option, f"{shown}: Permission denied", "a place that can be written to")
    _require_replaceable(path, option, force)


def _require_replaceable(path: Path, option: str, force: bool) -> None:
    """Raise UserError for a file that this option did not write, or that was changed since.

    path: of an output, which may not exist. Nothing is in the way with `force`, nor of an empty
    file, a device or a standard stream.
    """
    if force or not path.is_file() or not path.stat().st_size or _is_standard_stream(path):
        return
    digest = _digest_in_mark(path, option)
    shown = sanitized(path)
    if digest is None:
        got = f"{shown} exists, and {option} did not write it"
        raise UserError(option, got, "a new file", "--force replaces it")
    if not _is_unchanged(path.read_bytes(), option, digest):
        got = f"{shown} was changed since {option} wrote it"
        raise UserError(option, got, "a new file", "--force replaces it")


def _is_standard_stream(path: Path) -> bool:
    """Say whether the shell sends standard output or error to this file; it is then written
    through, like a device.
    """
    with suppress(OSError):
        return standard_stream(path.stat()) is not None
    return False


def _is_same(path: Path, other: Path) -> bool:
    with suppress(OSError):
        return path.samefile(other)
    return False


def input_files(*arguments: object) -> Iterator[Path]:
    """Yield the files that arguments of a command name, and those that these name in turn, each
    once, in no order that counts; arguments that name no file are passed over.
    """
    return _all_inputs(_existing(arguments))


def _all_inputs(inputs: Iterable[Path]) -> Iterator[Path]:
    """Inputs and the files that they name in quotes, and those name in turn, each once.

    inputs: files, and folders, whose texts count. Of more than _MOST_NAMED the rest is left out.
    """
    waiting = list(inputs)
    seen = set[Path]()
    while waiting and len(seen) < _MOST_NAMED:
        path = waiting.pop().absolute()
        if path in seen:
            continue
        seen.add(path)
        if path.is_dir():
            waiting += [p for p in path.iterdir() if p.suffix in _TEXTS and p.is_file()]
            continue
        yield path
        if path.suffix.lower() in _TEXTS:
            with suppress(OSError):
                waiting += _named(path, read_bytes(path))


def _named(path: Path, content: bytes) -> list[Path]:
    """Files that a text names in quotes: beside it, or in a folder that it names too, such as that
    of its meshes; those that do not exist are left out.

    path: of the text.
    content: its bytes.
    """
    names = set()
    for match in _QUOTED.findall(content):
        names.add(_without_function(match.decode(errors="replace")))
    beside = [path.parent / name for name in names]
    folders = [path.parent]
    folders += [path_beside for path_beside in beside if _is(path_beside, Path.is_dir)]
    named = itertools.product(folders, names)
    return [folder / name for folder, name in named if _is(folder / name, Path.is_file)]


def _is(path: Path, what: Callable[[Path], bool]) -> bool:
    """Return what a test says of a path; False for a path that the system does not take."""
    try:
        return what(path)
    except (OSError, ValueError):
        # A name that is too long, or has a null character.
        return False


def _mark(option: str, digest: bytes) -> bytes:
    return b"written by hcbench %s, digest %s" % (option.removeprefix("--").encode(), digest)


def _digest(content: bytes) -> bytes:
    return hashlib.sha256(content).hexdigest()[:16].encode()


def _digest_in_mark(path: Path, option: str) -> bytes | None:
    """The digest in the last mark of this option at the end of a file; None without one."""
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _TAIL))
        found = re.findall(re.escape(_mark(option, b"")) + rb"([0-9a-f]{16})", file.read())
    return found[-1] if found else None


def _is_unchanged(content: bytes, option: str, digest: bytes) -> bool:
    """Say whether a file has the digest that its mark states. content: of the file, marked."""
    before, frame, after = content.rpartition(_frame(content, option, digest))
    return bool(frame) and _digest(before + after) == digest


def _marked(content: bytes, option: str) -> bytes:
    """The content with its mark: a last comment, that of a ZIP archive, a text chunk before the
    last of a PNG, or a last key in JSON, which takes no comment.

    option: the one that writes it.
    Raises ValueError for JSON without a last object that has a key.
    """
    after = _after_mark(content)
    before = content.removesuffix(after)
    if _is_json(content) and (not after or before.rstrip().endswith(b"{")):
        raise ValueError(f"JSON of {option} has no last object with a key, to take its mark")
    if content.startswith(_ZIP):
        # An archive ends with the length of its comment, 2 bytes; NumPy writes none.
        before = content[:-2]
    elif not after and not content.endswith(b"\n"):
        before += b"\n"
    return before + _frame(content, option, _digest(before + after)) + after


def _after_mark(content: bytes) -> bytes:
    """The end of a content that must stay its end: the last chunk of a PNG, 12 bytes; the brackets
    of JSON; of other files nothing.
    """
    if content.startswith(_PNG):
        return content[-12:]
    if _is_json(content) and (end := _JSON_END.search(content)):
        return end.group()
    return b""


def _is_json(content: bytes) -> bool:
    """Say whether a content is a JSON object or list; Markdown and TOML may begin with "[" too."""
    if not content.startswith((b"{", b"[")):
        return False
    with suppress(ValueError):
        json.loads(content)
        return True
    return False


def _frame(content: bytes, option: str, digest: bytes) -> bytes:
    """The mark in the form that a file takes: a chunk of a PNG, the comment of a ZIP archive, a
    last key of JSON, else a line of comment.

    content: of the file, marked or not, by whose beginning its form is known.
    option: the one that writes the file.
    digest: of all else in it, in hexadecimal.
    """
    mark = _mark(option, digest)
    if content.startswith(_PNG):
        chunk = b"tEXtComment\0" + mark
        # Length of the data, type and data, checksum of these two.
        return (len(chunk) - 4).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    if content.startswith(_ZIP):
        return len(mark).to_bytes(2, "little") + mark
    if _is_json(content):
        return f',\n "{MARK_KEY}": "'.encode() + mark + b'"'
    if content.lstrip().startswith(b"<") or option == "--markdown":
        return b"<!-- " + mark + b" -->\n"
    return b"# " + mark + b"\n"
