"""Random inputs: command lines and the files that they name, each by its number alone."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

NUMBERS = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "0.3",
    "0.31",
    ".9",
    "1e-3",
    "1e-4",
    "1/240",
    "2e-4",
    "0.5",
    "5",
    "1e-12",
    "1e-320",
    "1e300",
    "1e30",
    "-1e30",
    "nan",
    "inf",
    "-inf",
    "1,5",
    "1_000",
    "0x10",
    "٣",
    "𝟑",
    "1e",
    "++1",
    "--1",
    "1e9",
    "1e15",
    "0.999",
    "1.0001",
    "100000",
    "1:2",
    "1:2:3",
    "1:20",
    "0.1:1:3",
    "1:2:1e9",
    "0.1,0.2",
    "0.1;0.2",
    "{}",
    "%s",
    "$(x)",
    "±",
    "0.3+-0.01",
    "0.3±0.5",
]
UNITS = " | m/s| in/s| s/in| s/m| s| ms| year| m| cm| km| mm| lb| kg| g| psi| Pa| N/m^1.5| lbf/in^1.5| m/s^2| deg| rad"
UNITS += "| rad/s| Hz| --s/m| m^^2| 1e9| s-1| furlong| 'x'| /| (m| m)| ^| **2| €"
NAMES = [
    "ball",
    "plate",
    "",
    "ball2",
    'a"b<c',
    "body:0",
    "geom:1",
    "0",
    "ball,plate",
    "плита",
    "x" * 300,
    "../x",
    "\u202e",
]
HEADERS = "time [s]|time [ms]|time [year]|height [cm]|height [km]|speed [m/s],restitution|v_in [m/s],v_out [m/s]|time [s],height [m]"
HEADERS += "|time [ms],force [N]|penetration [um],rate [m/s],force [N]|speed,restitution|x|time [s|height (cm)|"
GOOD_DATA = {
    "height [cm]": ["30", "22", "17", "13.5", "11", "9.2", "7.8"],
    "time [s]": ["0", "0.443", "0.842", "1.201", "1.524", "1.815"],
    "speed [m/s],restitution": ["0.1,0.95", "0.3,0.9", "0.5,0.86", "0.8,0.8", "1.1,0.75"],
}
MODEL = """<mujoco><option timestep="{timestep}" gravity="0 0 {gravity}" integrator="{integrator}"/><worldbody>
<geom name="plate" type="plane" size="1 1 1" {contact}/><body name="ball" pos="0 0 1"><{joint}/>
<geom name="ball" type="{type}" size="{size}" mass="{mass}" {contact}/></body></worldbody></mujoco>"""
URDF = """<robot name="r"><link name="l"><contact><restitution value="{e}"/><lateral_friction value="{mu}"/></contact>
<inertial><mass value="{mass}"/><inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>
<collision><geometry><sphere radius="{size}"/></geometry></collision></link></robot>"""
PLANE = URDF.format(e=1, mu=0, mass=0, i=0, size=1).replace(
    '<sphere radius="1"/>', '<box size="9 9 0.1"/>'
)
STUDY = """scene = {scene}
alphas = {alpha}
speeds = {speed}
phases = {phases}
{more}
[[run]]
engine = {engine}
recipe = {recipe}
timesteps = {step}
"""


class Inputs:
    """Inputs of a folder for files."""

    def __init__(self, folder: Path, number: int) -> None:
        self.folder, self.random = folder, random.Random(number)
        self.good = 0.55 if number % 2 else 0.9  # share of values that are as they should be

    def text(self, good: str) -> str:
        """A value that is good, or something else."""
        if self.random.random() < self.good:
            return good
        number = self.random.choice(NUMBERS)
        if self.random.random() < 0.3:
            number = f"{self.random.choice([-1, 1, 1, 1]) * 10 ** self.random.uniform(-12, 12):.{self.random.randrange(9)}g}"
        return number + self.random.choice(UNITS.split("|"))

    def some(self, **options: str) -> list[str]:
        """Some of these options, with values that may be good."""
        kept = [name for name in options if self.random.random() < 0.4]
        return [f"--{name.replace('_', '-')}={self.text(options[name])}" for name in kept]

    def choice(self, *items: Any) -> Any:
        """One of them."""
        return self.random.choice(items)

    def file(self, name: str, content: str | bytes) -> str:
        """A file with this content, sometimes damaged."""
        data = content.encode() if isinstance(content, str) else content
        if self.random.random() < 0.08 and data:
            at = self.random.randrange(len(data))
            data = (self.choice("cut", "byte", "twice") == "cut" and data[:at]) or data[
                :at
            ] + b"\xff\x00" + data[at:]
        (self.folder / name).write_bytes(data)
        return str(self.folder / name)

    def data(self) -> str:
        """A file of measurements."""
        if self.random.random() < 0.4:
            header = self.random.choice(list(GOOD_DATA))
            rows = list(GOOD_DATA[header])
            if self.random.random() < 0.5:
                rows[self.random.randrange(len(rows))] = self.text(rows[0])
            return self.file("data.csv", "\n".join([header, *rows]) + "\n")
        header = self.random.choice(HEADERS.split("|"))
        count, columns = self.random.randrange(12), header.count(",") + 1
        kinds: list[Callable[[int], float]] = [
            lambda i: 0.1 * (i + 1), lambda i: 30 * 0.7**i, lambda i: 1.0, lambda i: self.random.gauss(0, 1),
            lambda i: 10 ** self.random.uniform(-9, 9), lambda i: 0.5 * i**0.9,
        ]  # fmt: skip
        each = [self.random.choice(kinds) for _ in range(columns)]
        rows = [",".join(f"{kind(i):.5g}" for kind in each) for i in range(count)]
        return self.file("data.csv", "\n".join([header, *rows]) + "\n")

    def state(self) -> str:
        """A pose."""
        values = [0, 0, 1, self.choice("1", "0", "nan"), 0, 0, 0]
        if self.random.random() < 0.5:
            numbers = [float(str(v)) for v in values]
            kind: Any = self.random.choice([float, complex, object])
            with (self.folder / "state.npz").open("wb") as file:
                np.savez(file, qpos=np.array(numbers, dtype=kind))
            return str(self.folder / "state.npz")
        return self.file("state.json", json.dumps({self.choice("qpos", "ball", "x"): values}))

    def model(self) -> str:
        """A model file."""
        good = {
            "timestep": "1e-3", "gravity": "-9.81", "size": "0.1", "mass": "1", "contact": 'solref="-10000 -5"',
            "joint": "freejoint", "type": "sphere", "integrator": "Euler",
        }  # fmt: skip
        for name in ("timestep", "gravity", "size", "mass"):
            if self.random.random() < 0.2:
                good[name] = self.text(good[name]).split(" ")[0]
        if self.random.random() < 0.3:
            pair = f"{self.choice('-1000', '0.02', '0', '1e300', 'nan')} {self.choice('-1', '1', '0', '-1e300')}"
            good["contact"] = self.choice(
                f'solref="{pair}"', 'friction="-1 0 0"', 'friction="1e9 0 0"', 'margin="1e9"'
            )
        if self.random.random() < 0.2:
            good["type"], good["size"] = "box", "0.1 0.1 0.1"
        good["integrator"] = self.choice("Euler", "implicitfast", "RK4", "Euler")
        return self.file("model.xml", MODEL.format(**good))

    def urdf(self) -> str:
        """A model of PyBullet, on a plane."""
        good = {"e": "0.9", "mu": "0.1", "mass": "1", "i": "0.01", "size": "0.1"}
        for name in good:
            if self.random.random() < 0.25:
                good[name] = self.choice("0", "-1", "2", "nan", "1e300", "1e-9", "0.5", "1e6")
        self.file("plate.urdf", PLANE)
        return self.file("ball.urdf", URDF.format(**good))

    def launch(self) -> list[str]:
        """Options of launches, few of them."""
        speeds = f"--speeds={self.text(self.choice('0.3', '0.1, 0.5 m/s', '0.2'))}"
        more = self.some(
            timestep="1e-3", gravity="9.81", key="qpos0", height="1 cm", qpos="ball=0 0 1 1 0 0 0", angle="30 deg",
            along="0,1,0", spin="40 rad/s", limit="20 s",
        )  # fmt: skip
        more += [f"--from={self.choice('above', '+x', '0,1,1', '0,0,0', 'x')}"] * (
            self.random.random() < 0.1
        )
        more += [f"--state={self.state()}"] * (self.random.random() < 0.2)
        pair = f"--pair={self.choice('ball,plate', 'ball,plate', 'ball,plate', self.random.choice(NAMES))}"
        return [pair, "--phases=1", speeds, *more]


def _law(i: Inputs) -> list[str]:
    wanted = [f"--alpha={i.text('0.008 s/in')}", f"--speeds={i.text('4, 8 in/s')}"]
    return ["law", *wanted, *i.some(mass="1 lb", stiffness="3.1e7 lbf/in^1.5", exponent="1.5")]


def _convert(i: Inputs) -> list[str]:
    one = i.choice(
        "alpha=0.31", "drake=0.31", "simbody=0.2", "restitution=0.9", "solref=-2.7e8 -815"
    ).split("=")
    rest = i.some(speed="0.2 m/s", contact_time="0.2 ms", timestep="1e-3", alpha="0.3")
    return [
        "convert",
        f"--{one[0]}={i.text(one[1])}",
        *rest,
        *i.some(target=i.choice("law", "linear")),
    ]


def _fit(i: Inputs) -> list[str]:
    files = [i.data()] * (1 + (i.random.random() < 0.05))
    known = i.some(
        height="30 +- 0.1 cm", gravity="9.81", mass="3 g", diameter="40 mm", contact_time="0.1 ms", timing="1 ms",
        speed="1 m/s", exponent="1.5",
    )  # fmt: skip
    law = [f"--law={i.choice('auto', 'hunt-crossley', 'constant', 'viscoelastic', 'plastic')}"]
    return ["fit", *files, *known, *law * (i.random.random() < 0.3)]


def _measure(i: Inputs) -> list[str]:
    return ["measure", i.model(), *i.launch(), *i.some(restitution="0.9", alpha="0.3")]


def _bullet(i: Inputs) -> list[str]:
    pair = ["--pair=ball.urdf,plate.urdf"] if i.random.random() < 0.8 else []
    launch = [option for option in i.launch() if not option.startswith("--pair")]
    return ["measure", i.urdf(), str(i.folder / "plate.urdf"), *pair, *launch]


def _check(i: Inputs) -> list[str]:
    target = (
        i.some(restitution="0.9")
        or i.some(alpha="0.3")
        or [f"--points={i.data()}"] * (i.random.random() < 0.5)
    )
    options = i.some(max_error="0.05", target="law")
    outputs = [
        f"--{name}={i.folder / i.choice(name, 'model.xml', 'no/x')}"
        for name in ("junit", "markdown")
        if i.random.random() < 0.2
    ]
    return ["check", i.model(), *i.launch(), *target, *options, *outputs]


def _land(i: Inputs) -> list[str]:
    heights = i.choice(
        "nan", "-1", "0", "1e9 m", "1 kg", "0.5 cm"
    )  # most are refused: the others take seconds
    options = i.some(
        tilt="5 deg",
        controller="pd:10,1",
        key="qpos0",
        qpos="base=0,0,0.3",
        timestep="1e-3",
        gravity="9.81",
    )
    return ["land", i.model(), f"--heights={heights}", *options]


def _cases(i: Inputs) -> list[str]:
    body = [i.choice(0.1, -1.0, 1e300, None, "x") if i.random.random() < 0.1 else 0.1] * 9
    states = [[step, body] for step in (0, 1, 2, 40, 41, 42)]
    run = i.choice(
        {"states": states}, {"states": states[:1]}, {"unsupported": "no"}, {"error": "x"}, {}, []
    )
    runs = {
        f"C{n:02d}": [run] * i.choice(1, 2, 114, 120, 132) for n in range(1, i.choice(2, 3, 16))
    }
    engine = {
        "name": i.choice("x", 3, ""),
        "version": "1",
        "combine": i.choice("product", None, "x"),
    }
    content = {
        "format": i.choice(1, 1, 2),
        "set": "hcbench-cases-1",
        "engine": engine,
        "runs": runs,
    }
    return [
        "cases",
        "score",
        i.file("results.json", json.dumps(i.choice(content, [content], [], 1))),
    ]


def _pairs(i: Inputs) -> list[str]:
    return ["pairs", i.model(), *i.some(key="qpos0", qpos="ball=1")]


def _tune(i: Inputs) -> list[str]:
    target = i.choice("alpha=0.3", "restitution=0.9", "points=0.1:0.95, 0.5:0.85 m/s").split("=")
    more = i.some(
        mass="1 lb",
        stiffness="1e9",
        exponent="1.5",
        gravity="9.81",
        friction="0.1",
        corners="4",
        speeds="0.1:1:3",
    )
    if i.random.random() < 0.9 and not any("=1e" in m or "--" in m[2:] for m in more):
        more.append(
            f"--speeds={i.choice('nan', '1e9', '-1', '0', 'x', '1 kg')}"
        )  # most are refused: the others take seconds
    engine, step = i.choice("mujoco", "pybullet", "mujoco", "x"), i.text("1e-3")
    return [
        "tune",
        engine,
        f"--{target[0]}={i.text(target[1])}",
        f"--timestep={step}",
        "--recipe=" + i.choice("impulse", "restitution", "x"),
        *more,
    ]


def _study(i: Inputs) -> list[str]:
    def value(good: str) -> str:
        text = good if i.random.random() < 0.8 else i.text(good)
        return json.dumps(text) if i.random.random() < 0.9 else text

    more = "\n".join(f"{name} = {value(text)}" for name, text in (
        ("train_height", "1 mm"), ("gravity", "9.81"), ("friction", "0.1"), ("angles", "30 deg"), ("x", "1"), ("loop_speeds", "0.2"),
    ) if i.random.random() < 0.12)  # fmt: skip
    content = STUDY.format(
        scene=value("steel-plane"), alpha=value("0.3"), speed=value("0.2"), phases=i.choice("1", "1", "0", "1e9", '"1"'),
        engine=value("reference"), recipe=value("hunt-crossley"), step=value("1e-6"), more=more,
    )  # fmt: skip
    return ["check", i.file("study.toml", content), *i.some(max_error="0.05")]


_KINDS = {
    _law: 26,
    _convert: 26,
    _fit: 24,
    _measure: 7,
    _bullet: 4,
    _check: 4,
    _pairs: 4,
    _tune: 2,
    _study: 3,
    _land: 2,
    _cases: 6,
}


def make(folder: Path, number: int) -> list[str]:
    """The arguments of one input; its files are in the folder."""
    inputs = Inputs(folder, number)
    kind = inputs.random.choices(list(_KINDS), list(_KINDS.values()))[0]
    arguments = kind(inputs)
    if arguments[0] not in ("fit",) or inputs.random.random() < 0.7:
        arguments += ["--json"] * (inputs.random.random() < 0.7)
    if inputs.random.random() < 0.03:
        arguments.append(inputs.choice("--x", "--beyond-bounds", "--help", "extra", ""))
    return arguments
