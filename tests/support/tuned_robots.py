"""Robots that others wrote, with feet tuned by their landing: `make test-models` writes the table of
docs/reference/robots.md.
"""

from __future__ import annotations

import time
import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import mujoco
from outside_models import found_file
from robot_landings import GRAVITY, ROBOTS, Robot, is_named_foot, path_of

import hcbench as hb
from hcbench.engines.mujoco.model.bodies import can_meet
from hcbench.workers.process import processor_seconds

if TYPE_CHECKING:
    from hcbench.tuning.tuned_model import TunedModel

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "robots.md"
BEGIN, END = "<!-- begin robots -->\n", "<!-- end robots -->"
_WALKS = "mujoco_playground/_src/locomotion"
_FLAT = "xmls/scene_mjx_feetonly_flat_terrain.xml"
_LEGS = ("FR", "FL", "RR", "RL")


@dataclass(frozen=True)
class BulletRobot:
    """A URDF that PyBullet drops on its plane.urdf. feet: names of links. pose: of joints, rad."""

    name: str
    file: str
    feet: tuple[str, ...]
    pose: tuple[tuple[str, float], ...] = ()


_DATA = "pybullet_data"
_TOES = tuple(f"{leg}_toe" for leg in _LEGS)
# Its legs are straight, and land on their shanks too.
_SHANKS = tuple(f"{part}_{leg}" for part in ("toe", "shank") for leg in ("fr", "fl", "hr", "hl"))
_BENT = tuple(
    (f"{leg}_{joint}_joint", angle)
    for leg in _LEGS
    for joint, angle in (("upper", 0.9), ("lower", -1.8))
)
TUNED = (
    *ROBOTS,
    Robot("dm_control dog", "dm_control/suite/dog.xml", "foot_.*|hand_.*|paw.*"),
    Robot("playground Apollo", f"{_WALKS}/apollo/{_FLAT}", ".*(foot|sole).*"),
    Robot("playground Berkeley Humanoid", f"{_WALKS}/berkeley_humanoid/{_FLAT}", ".*foot.*"),
    Robot("playground G1", f"{_WALKS}/g1/{_FLAT}", ".*foot.*"),
    Robot("playground Go1", f"{_WALKS}/go1/{_FLAT}", "FL|FR|RL|RR"),
    Robot("playground H1", f"{_WALKS}/h1/xmls/scene_mjx_feetonly.xml", ".*foot.*"),
    Robot("playground OP3", f"{_WALKS}/op3/xmls/scene_mjx_feetonly.xml", ".*foot.*"),
    Robot("playground Spot", f"{_WALKS}/spot/xmls/scene_mjx_flat_terrain.xml", "FL|FR|HL|HR"),
    Robot("playground T1", f"{_WALKS}/t1/{_FLAT}", ".*foot.*"),
    BulletRobot("pybullet_data A1", f"{_DATA}/a1/a1.urdf", _TOES, _BENT),
    BulletRobot("pybullet_data Aliengo", f"{_DATA}/aliengo/aliengo.urdf", _TOES, _BENT),
    BulletRobot("pybullet_data Mini Cheetah", f"{_DATA}/mini_cheetah/mini_cheetah.urdf", _SHANKS),
)
TARGETS = (0.0, 5e-3, 20e-3)  # m


@dataclass
class Answer:
    """Answer of `tune` for a robot and a target, m. cpu: s."""

    robot: Robot | BulletRobot
    target: float
    tuned: TunedModel
    cpu: float


def answer(robot: Robot | BulletRobot, target: float) -> Answer:
    """Tune the feet of a robot; an e of 0 in place of a rebound of 0."""
    asked: dict[str, Any] = {"rebound": target} if target else {"restitution": 0.0}
    source: Any
    if isinstance(robot, BulletRobot):
        floor = found_file("pybullet_data/plane.urdf")
        source = [str(found_file(robot.file)), str(floor)]
        feet = [f"{foot},{floor.name}" for foot in robot.feet]
        asked |= {"gravity": GRAVITY, "qpos": dict(robot.pose)}
    else:
        source = without_meshes(robot)
        feet = feet_of(robot, source)
    start = _processor_time()
    tuned = hb.tune_model(source, feet, **asked)
    return Answer(robot, target, tuned, _processor_time() - start)


def _processor_time() -> float:
    """Processor time of this process and its workers, s."""
    children = Path("/proc/thread-self/children").read_text(encoding="ascii").split()
    return time.process_time() + sum(processor_seconds(int(number)) for number in children)


def feet_of(robot: Robot, spec: Any) -> list[str]:
    """Pairs of the robot's feet with its floor."""
    model = spec.compile()
    still = [g for g in range(model.ngeom) if not model.body_weldid[model.geom_bodyid[g]]]
    floors = [g for g in still if model.geom_type[g] == mujoco.mjtGeom.mjGEOM_PLANE] or still
    pairs = []
    for geom in range(model.ngeom):
        is_foot = is_named_foot(robot, model, geom)
        is_foot = is_foot and bool(model.body_weldid[model.geom_bodyid[geom]])
        for floor in floors:
            if is_foot and can_meet(model, (geom, floor)):
                ends = [model.geom(g).name or str(g) for g in (geom, floor)]
                pairs.append(",".join(f"geom:{end}" for end in ends))
    assert pairs, robot
    return pairs


def without_meshes(robot: Robot) -> Any:
    """The spec of a robot's file; of a package without its meshes, which are for the eye alone."""
    path = path_of(robot)
    if not robot.file.startswith(_WALKS):
        return mujoco.MjSpec.from_file(str(path))
    root = ET.parse(path).getroot()
    _include(root, path.parent)
    for parent in list(root.iter()):
        for child in list(parent):
            is_mesh = child.tag == "mesh" or (child.tag == "geom" and "mesh" in child.attrib)
            is_file = child.tag in ("texture", "hfield") and "file" in child.attrib
            if is_mesh or is_file or (child.tag == "material" and "texture" in child.attrib):
                parent.remove(child)
            child.attrib.pop("material", None)
    return mujoco.MjSpec.from_string(ET.tostring(root, encoding="unicode"))


def _include(element: ET.Element, folder: Path) -> None:
    """Put the elements of included files in the place of each <include>."""
    for i, child in reversed(list(enumerate(element))):
        if child.tag == "include":
            included = ET.parse(folder / child.attrib["file"]).getroot()
            element.remove(child)
            for one in reversed(included):
                element.insert(i, one)
    for child in element:
        _include(child, folder)


def row(of: Answer) -> list[str]:
    """The cells of the page's table."""
    change = of.tuned.landing
    assert change is not None
    was, now = change.before, change.after
    said = of.tuned.name
    if not of.tuned.gains:
        said = "refused, chance" if is_chance(of) else "refused"
    largest = "" if change.reach is None else f"{1e3 * change.reach.rebound:.3g}"
    falls = " (falls)" if was.falls else ""
    return [
        f"{of.robot.name}{falls}",
        f"{1e3 * of.target:g}",
        said,
        f"{1e3 * was.rebound:.1f} / {1e3 * now.rebound:.1f}",
        largest,
        f"{was.peak:.1f} / {now.peak:.1f}",
        f"{1e3 * was.depth:.1f} / {1e3 * now.depth:.1f}",
        f"{was.rest:.2f} / {now.rest:.2f}",
        f"{1e3 * was.travel:.0f} / {1e3 * now.travel:.0f}",
        f"{1e3 * was.creep:.2f} / {1e3 * now.creep:.2f}",
        f"{of.cpu:.0f}",
    ]


def is_chance(of: Answer) -> bool:
    """Say whether an answer is refused for its chance alone: it has no largest rebound then."""
    change = of.tuned.landing
    assert change is not None
    return change.reach is None and not of.tuned.gains and change.after.is_chance(of.target)


HEAD = (
    *("robot", "target, mm", "answer", "rebound, mm", "largest, mm", "peak / weight"),
    *("depth, mm", "rest, s", "travel, mm", "creep, mm/s", "CPU s"),
)


def write_page(answers: list[Answer]) -> None:
    """Put the table between the page's marks."""
    rows = [[cell.replace("nan / nan", "") for cell in row(each)] for each in answers]
    lines = [f"| {' | '.join(cells)} |" for cells in (HEAD, ["---"] * len(HEAD), *rows)]
    head, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    table = "".join(f"{line}\n" for line in lines)
    said = counted([dict(zip(HEAD, cells, strict=True)) for cells in rows])
    text = f"{head}{BEGIN}{said}\n\n{table}{END}{rest.partition(END)[2]}"
    PAGE.write_text(text, encoding="utf-8")


def counted(rows: list[dict[str, str]]) -> str:
    """A sentence of how many robots and answers of each kind the rows have."""
    robots = len({row["robot"].removesuffix(" (falls)") for row in rows})
    kinds = [row["answer"] for row in rows]
    stays = kinds.count("as it is")
    refused = sum(kind.startswith("refused") for kind in kinds)
    tuned = len(rows) - stays - refused
    return (
        f"{robots} robots, {len(rows)} answers: {tuned} settings, {stays} models that have the "
        f"target already, {refused} refusals."
    )


def on_the_page() -> list[dict[str, str]]:
    """The page's rows, by the heads of its columns."""
    table = PAGE.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    rows = [line for line in table.splitlines() if line.startswith("|")]
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in rows]
    return [dict(zip(HEAD, cells, strict=True)) for cells in lines[2:]]
