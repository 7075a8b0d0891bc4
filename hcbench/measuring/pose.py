"""Poses and directions as users write them: joints by name, state files, "above"."""

import io
import math
import zipfile
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hcbench.sim.model_under_test import Vector
from hcbench.system.errors import QuantityError, UserError
from hcbench.system.files import parse_json, read_bytes, read_text, require_small_archive
from hcbench.terms import units

Pose = tuple[tuple[str, tuple[float, ...]], ...]

STATE_FIELDS = ("qpos", "ctrl", "act", "mocap_pos", "mocap_quat", "eq_active")
_ANGLES = {"deg": math.pi / 180.0, "°": math.pi / 180.0, "rad": 1.0}
_DIRECTIONS: dict[str, Vector] = {
    "above": (0.0, 0.0, 1.0),
    "below": (0.0, 0.0, -1.0),
    "+x": (1.0, 0.0, 0.0),
    "-x": (-1.0, 0.0, 0.0),
    "+y": (0.0, 1.0, 0.0),
    "-y": (0.0, -1.0, 0.0),
    "+z": (0.0, 0.0, 1.0),
    "-z": (0.0, 0.0, -1.0),
}


def read_joints(text: Any) -> Pose:
    """Joints as "hip=0.3, knee=-30 deg, base=0, 0, 0.3", or a mapping
    of names. Raises QuantityError.
    """
    if text is None:
        return ()
    if isinstance(text, Mapping):
        return tuple((str(name), _numbers(name, values)) for name, values in text.items())
    pose: list[tuple[str, tuple[float, ...]]] = []
    for part in str(text).split(","):
        name, equals, values = map(str.strip, part.rpartition("="))
        # A further value of the joint before.
        if not equals and pose and values:
            last, before = pose[-1]
            pose[-1] = last, (*before, *_values(last, values))
            continue
        if not (name and equals and values):
            expected = "joints with their values: 'hip=0.3, knee=-30 deg, base=0, 0, 0.3'"
            raise QuantityError("qpos", repr(part.strip()), expected)
        pose.append((name, tuple(_values(name, values))))
    return tuple(pose)


def _values(name: str, text: str) -> list[float]:
    """Numbers of a joint in text, rad or m: "-30 deg", "1 0 0 0", "2 cm". Raises QuantityError."""
    number, _, unit = text.rpartition(" ")
    if unit in _ANGLES:
        return [_ANGLES[unit] * x for x in _numbers(name, number.split())]
    try:
        return list(_numbers(name, text.split()))
    except QuantityError:
        return [units.parse(text, "position", f"qpos: {name}")]


def _numbers(name: Any, values: Any) -> tuple[float, ...]:
    """The values of a joint as finite numbers; raises QuantityError for anything else."""
    try:
        array = np.asarray(values)
        numbers = () if array.dtype.kind == "c" else tuple(array.astype(float).reshape(-1).tolist())
    except (TypeError, ValueError):
        numbers = ()
    if not numbers or not all(map(math.isfinite, numbers)):
        raise QuantityError(
            "qpos", f"{name}: {str(values)[:60]!r}", "numbers, such as '0.3' or '-30 deg'"
        )
    return numbers


def read_state(state: Any) -> Pose:
    """The arrays of a state file: .npz, or JSON with names and numbers; of
    joints, or whole, such as qpos.

    Of an engine's state in Python, such as an MjData, those of its fields that are a pose. Raises
    UserError for anything else, QuantityError for numbers that are not finite.
    """
    if state is None:
        return ()
    if isinstance(state, str | Path):
        return read_joints(read_named(Path(state), "state", "a pose"))
    fields = {name: getattr(state, name) for name in STATE_FIELDS if hasattr(state, name)}
    if "qpos" not in fields:
        expected = "a .npz or JSON file with a pose, or a state that has qpos, such as an MjData"
        raise UserError("state", f"a {type(state).__name__}", expected)
    return read_joints({name: values for name, values in fields.items() if np.size(values)})


def read_named(file: Path, slot: str, what: str) -> Mapping[str, Any]:
    """The named arrays of an .npz or JSON file.

    slot, what: of the error, UserError.
    what: it should have.
    """
    try:
        if file.suffix == ".npz":
            content: Any = _arrays(read_bytes(file))
        else:
            content = parse_json(read_text(file))
    except (OSError, ValueError, EOFError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(slot, f"{file}: {error}", f"a .npz or JSON file with {what}") from None
    if not isinstance(content, Mapping) or not content:
        raise UserError(
            slot, f"{file} has no names in it", 'JSON like {"hip": 0.3}, or {"qpos": [...]}'
        )
    return content


def _arrays(content: bytes) -> dict[str, Any]:
    """The arrays of an .npz file; ValueError for one that is damaged, or unpacks to more than may be
    read.
    """
    try:
        require_small_archive(content)
        with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files}
    except Exception as error:
        # A damaged header raises anything that Python's tokenizer and zipfile raise.
        raise ValueError(f"is damaged: {error}") from None


def read_direction(text: Any) -> Vector:
    """A unit vector of "above", "-x" or "0,1,1"; the side of the first body. Raises QuantityError."""
    if isinstance(text, str) and text.strip() in _DIRECTIONS:
        return _DIRECTIONS[text.strip()]
    parts = text.split(",") if isinstance(text, str) else list(text)
    try:
        x, y, z = map(float, parts)
        length = math.sqrt(x * x + y * y + z * z)
    except (TypeError, ValueError):
        length = 0.0
    if not (math.isfinite(length) and length > 0):
        raise QuantityError(
            "from", repr(text), f"one of {', '.join(_DIRECTIONS)}, or three numbers: 0,1,1"
        )
    return x / length, y / length, z / length
