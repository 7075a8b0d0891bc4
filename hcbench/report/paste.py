"""A setting as its user would write it: what to paste into a model or a script."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


def paste(record: Mapping[str, Any], form: str, radius: float) -> str:
    """Text to paste for one record of Results.settings; "" where there is nothing to set.

    form: the scene's, "plane" or "cup". radius: of the sphere that meets the plane, m. A record that brings
    its own text ("paste") is taken at its word; options of an engine not known here are shown as JSON.
    """
    options = record["options"]
    if record.get("paste"):
        return str(record["paste"])
    if not options:
        return ""
    if record["engine"] == "mujoco" and options.get("rows"):
        head = [_mujoco_option(record["timestep_s"], options)]
        return "\n".join(head + (_limits(options) if form == "cup" else _pairs(options, radius)))
    if record["engine"] == "pybullet" and {"world", "ball", "plate"} & set(options):
        return _pybullet(record["timestep_s"], options)
    return json.dumps(options, indent=1, ensure_ascii=False)


def _number(value: float) -> str:
    """The fewest digits that read back the same."""
    short = f"{value + 0.0:.15g}"
    return short if float(short) == value else repr(float(value))


def _list(values: list[float]) -> str:
    return " ".join(map(_number, values))


def _mujoco_option(timestep: float, options: Mapping[str, Any]) -> str:
    integrator = f' integrator="{options["integrator"]}"' if options.get("integrator") else ""
    return f'<option timestep="{_number(timestep)}"{integrator}/>'


def _pairs(options: Mapping[str, Any], radius: float) -> list[str]:
    """A <pair> a row, and the massless copies of the ball's geom that rows after the first act on."""
    copies, pairs = [], []
    for number, row in enumerate(options["rows"], 1):
        name = "ball" if number == 1 else f"ball.{number}"
        if number > 1:
            size = f'type="sphere" size="{_number(radius)}" mass="0" contype="0" conaffinity="0"'
            copies.append(f'<geom name="{name}" {size}/>')
        words = [f'solref="{_list(row["solref"])}"', f'solimp="{_list(row["solimp"])}"']
        words += [f'margin="{_number(-row["onset"])}"'] if row.get("onset") else []
        words += [f'adhesion="{_number(row["adhesion"])}"'] if row.get("adhesion") else []
        pairs.append(f'<pair geom1="{name}" geom2="plate" condim="1" {" ".join(words)}/>')
    if not copies:
        return pairs
    return ["<!-- in the ball's body, beside its geom -->", *copies, "<!-- in <contact> -->", *pairs]


def _limits(options: Mapping[str, Any]) -> list[str]:
    """The cup's contact is the limit of the tendon between the two centres."""
    lines = ['<!-- on the tendon "contact"; more rows are copies of it -->']
    for row in options["rows"]:
        words = f'solreflimit="{_list(row["solref"])}" solimplimit="{_list(row["solimp"])}"'
        deeper = f" <!-- upper end of range: {_number(row['onset'])} m more -->" if row.get("onset") else ""
        lines.append(words + deeper)
    return lines


def _pybullet(timestep: float, options: Mapping[str, Any]) -> str:
    """The calls, in the order that works."""
    world = {"fixedTimeStep": timestep, **options.get("world", {})}
    maximal = ", useMaximalCoordinates=True" if options.get("maximal_coordinates") else ""
    bodies = ("ball", "plate")
    lines = [
        f"pybullet.setPhysicsEngineParameter({_arguments(world)})",
        *(f'{body} = pybullet.loadURDF("{body}.urdf"{maximal})' for body in bodies),
        *(f"pybullet.changeDynamics({b}, -1, {_arguments(options[b])})" for b in bodies if options.get(b)),
    ]
    return "\n".join(lines)


def _arguments(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{k}={_number(v) if isinstance(v, float) else repr(v)}" for k, v in values.items())
