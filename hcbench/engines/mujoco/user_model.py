"""A user's own MuJoCo model, from whatever holds it: loaded and checked, with its start configuration."""

from __future__ import annotations

import copy
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, captured_warnings
from hcbench.errors import EngineFailed, SceneError, UserError
from hcbench.units import LARGEST, SMALLEST

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.sim.model_under_test import Request

SUFFIXES = (".xml", ".mjcf", ".urdf", ".mjb", ".mjz")


def load(source: Any, request: Request) -> tuple[Any, str]:
    """(MjModel, what to call it) with the request's step and gravity; the user's own object stays as it was.

    source: a path, an MjModel, an MjSpec, or MJCF text. Raises SceneError for what does not compile.
    """
    mujoco = backend()
    with captured_warnings() as warnings:
        if isinstance(source, mujoco.MjModel):
            model, label = copy.copy(source), "MjModel"
        elif isinstance(source, mujoco.MjSpec):
            model, label = _compiled(source.copy().compile, "MjSpec"), "MjSpec"
        elif isinstance(source, str) and source.lstrip().startswith("<"):
            label = "MJCF text"
            model = _compiled(partial(mujoco.MjModel.from_xml_string, source), label)
        else:
            model, label = _from_file(mujoco, Path(source)), Path(source).name
    if any("NaN" in line for line in warnings):
        raise SceneError("model", f"{label} has a NaN in it", "numbers", "Look for 'nan' in the file")
    _require_sound(model, label)
    if request.timestep is not None:
        model.opt.timestep = request.timestep
    if request.gravity is not None:
        model.opt.gravity[:] = request.gravity
    return model, label


def _from_file(mujoco: Any, path: Path) -> Any:
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "is not there"
        raise SceneError("model", f"{path} {what}", f"a model file: {', '.join(SUFFIXES)}")
    binary = path.suffix.lower() == ".mjb"
    read = mujoco.MjModel.from_binary_path if binary else mujoco.MjModel.from_xml_path
    return _compiled(partial(read, str(path)), str(path))


def _compiled(compile_model: Callable[[], Any], label: str) -> Any:
    try:
        return compile_model()
    except (ValueError, RuntimeError, TypeError, OSError) as error:
        words = " ".join(str(error).split()).removeprefix("Error: ").removeprefix("XML Error: ")
        if "allocate" in words:
            raise EngineFailed("model", f"{label}: {words}", "a model that fits into memory") from None
        raise SceneError("model", f"{label}: {words}", "a model that MuJoCo compiles") from None


def _require_sound(model: Any, label: str) -> None:
    """Refuse what the compiler lets through and no simulation survives."""
    for kind, field in (("body", "mass"), ("body", "inertia"), ("geom", "size")):
        values = getattr(model, f"{kind}_{field}")
        bad = np.argwhere(~np.isfinite(values))
        if bad.size:
            raise SceneError("model", f"{label}: {field} of {kind} {bad[0][0]} is not finite", "numbers")
    if (model.body_mass < 0).any():
        raise SceneError("model", f"{label}: a body of negative mass", "masses of 0 kg or more")
    if not SMALLEST <= model.opt.timestep <= LARGEST:
        expected = f"a step of {SMALLEST:g} ... {LARGEST:g} s"
        raise SceneError("timestep", f"{label}: {model.opt.timestep!r} s", expected)


def start(model: Any, key: str | None) -> tuple[Any, str]:
    """(MjData at rest in the start configuration, its name).

    key: name or number of a keyframe, or "qpos0"; None: the first keyframe, or qpos0 where there is none.
    """
    names = ["qpos0", *(model.key(i).name or str(i) for i in range(model.nkey))]
    if key is None:
        key = names[min(1, model.nkey)]
    elif key not in names:
        if not key.isdecimal() or int(key) >= model.nkey:
            raise UserError("key", repr(key), f"one of: {', '.join(names)}")
        key = names[1 + int(key)]
    mujoco = backend()
    data = mujoco.MjData(model)
    if key != "qpos0":
        mujoco.mj_resetDataKeyframe(model, data, names.index(key) - 1)
        data.qvel[:] = 0.0
        data.time = 0.0
    return data, key if key == "qpos0" else f"keyframe {key!r}"
