"""A setting as its user would write it: what to paste into a model or a script."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


def paste(record: Mapping[str, Any]) -> str:
    """Text to paste for one record of Results.settings; "" where there is nothing to set."""
    given = record.get("paste")
    options = record["options"]
    if given:
        return str(given)
    if not options:
        return ""
    if record["engine"] == "mujoco" and options.get("rows"):
        return _mujoco(record["timestep_s"], options)
    if record["engine"] == "pybullet" and {"world", "ball", "plate"} & set(options):
        return _pybullet(record["timestep_s"], options)
    return json.dumps(options, indent=1, ensure_ascii=False)


def _number(value: Any) -> str:
    """The fewest digits that read back the same."""
    return f"{value:.15g}" if float(f"{value:.15g}") == value else repr(float(value))


def _mujoco(timestep: float, options: Mapping[str, Any]) -> str:
    lines = [f'<option timestep="{_number(timestep)}" integrator="{options.get("integrator", "Euler")}"/>']
    for row in options["rows"]:
        words = [f'{key}="{" ".join(map(_number, row[key]))}"' for key in ("solref", "solimp") if key in row]
        if row.get("onset"):
            words.append(f'margin="{_number(-row["onset"])}"')
        if row.get("adhesion"):
            words.append(f'adhesion="{_number(row["adhesion"])}"')
        lines.append(f'<pair geom1="ball" geom2="plate" condim="1" {" ".join(words)}/>')
    return "\n".join(lines)


def _pybullet(timestep: float, options: Mapping[str, Any]) -> str:
    world = {"fixedTimeStep": timestep, **options.get("world", {})}
    lines = [f"pybullet.setPhysicsEngineParameter({_arguments(world)})"]
    bodies = [body for body in ("ball", "plate") if options.get(body)]
    lines += [f"pybullet.changeDynamics({body}, -1, {_arguments(options[body])})" for body in bodies]
    if options.get("maximal_coordinates"):
        lines.insert(0, 'ball = pybullet.loadURDF("ball.urdf", useMaximalCoordinates=True)')
    return "\n".join(lines)


def _arguments(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{k}={_number(v) if isinstance(v, float) else repr(v)}" for k, v in values.items())
