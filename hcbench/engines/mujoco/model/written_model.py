"""A user's model with pairs in it, as text: the user's own and a few
lines, or else MuJoCo's own of it.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.scene.elements import quoted
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence

_SUFFIXES = (".xml", ".mjcf", ".urdf")
_END = "</mujoco>"
_INCLUDE = re.compile(r"(<include\s[^>]*?file\s*=\s*)([\"'])(.*?)\2", re.DOTALL)
_DIRECTORY = re.compile(r'\b(meshdir|texturedir|assetdir)="(/[^"]*)"')
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)


def spec_of(source: Any) -> Any:
    """A new MjSpec of the model, whose assets are found from everywhere.

    Raises UserError for a source that cannot be written.
    """
    mujoco = backend()
    if isinstance(source, mujoco.MjSpec):
        return source.copy()
    if isinstance(source, str) and source.lstrip().startswith("<"):
        return mujoco.MjSpec.from_string(source)
    if (path := _path(source)) is None:
        got = str(source) if isinstance(source, str | Path) else f"a {type(source).__name__}"
        raise UserError("model", got, "an MJCF file or an MjSpec, which can be written")
    spec = mujoco.MjSpec.from_file(str(path))
    if _has_assets(spec):
        for name in ("meshdir", "texturedir"):
            setattr(spec, name, str((path.parent / getattr(spec, name)).resolve()))
    return spec


def label_of(source: Any) -> str:
    """Name of the model in outputs: its file, or "model"."""
    is_file = isinstance(source, str | Path) and not str(source).lstrip().startswith("<")
    return Path(source).name if is_file else "model"


def _path(source: Any) -> Path | None:
    if isinstance(source, str | Path) and Path(source).suffix.lower() in _SUFFIXES:
        return Path(source)
    return None


def _has_assets(spec: Any) -> bool:
    return any(asset.file for asset in (*spec.meshes, *spec.hfields, *spec.textures, *spec.skins))


def whole_text(spec: Any, folder: Path | None) -> str:
    """MuJoCo's own text of a changed spec, with paths of its assets from a folder."""
    text = str(spec.to_xml())
    if folder is None:
        return text

    def moved(match: re.Match[str]) -> str:
        return f"{match[1]}={quoted(os.path.relpath(match[2], folder.resolve()))}"

    return _DIRECTORY.sub(moved, text)


def own_text(source: Any, folder: Path | None, lines: str) -> str:
    """Return the user's text, comments and includes and all, with more lines
    at its end; "" if it has none.

    folder: of the file that is to be written, from which its paths then lead.
    """
    path = _path(source)
    if path is not None and path.suffix.lower() != ".urdf":
        text = path.read_text(encoding="utf-8")
    elif isinstance(source, str) and source.lstrip().startswith("<mujoco"):
        text = source
    else:
        return ""
    head, end, tail = text.rpartition(_END)
    if not end or _END in _COMMENT.sub("", tail):
        return ""
    if path is not None and folder is not None and folder.resolve() != path.parent.resolve():
        head = _moved(head, path, folder)
        lines = f"{_directories(path, folder)}{lines}"
    return f"{head.rstrip()}\n\n{lines}\n{end}{tail}"


def _moved(text: str, path: Path, folder: Path) -> str:
    """A model's text with its includes as they are found from another folder."""

    def moved(match: re.Match[str]) -> str:
        return f"{match[1]}{quoted(os.path.relpath((path.parent / match[3]).resolve(), folder.resolve()))}"

    return _INCLUDE.sub(moved, text)


def _directories(path: Path, folder: Path) -> str:
    """A <compiler> that finds the assets from another folder; "" where there are none."""
    spec = spec_of(path)
    if not _has_assets(spec):
        return ""
    attributes = []
    for name in ("meshdir", "texturedir"):
        way = os.path.relpath(getattr(spec, name), folder.resolve())
        attributes.append(f"{name}={quoted(way)}")
    return f"<compiler {' '.join(attributes)}/>\n"


def included(lines: str) -> str:
    """A file of these lines, to be included."""
    return f"<mujocoinclude>\n{lines}\n</mujocoinclude>\n"


def taken_pairs(model: Any, geoms: Sequence[tuple[int, int]]) -> bool:
    """Say whether the model has <pair>s of its own for any of these geoms."""
    own = zip(model.pair_geom1.tolist(), model.pair_geom2.tolist(), strict=True)
    # In a frozenset the order of the two does not matter.
    return not set(map(frozenset, own)).isdisjoint(map(frozenset, geoms))
