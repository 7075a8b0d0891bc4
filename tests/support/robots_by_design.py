"""Robots of many kinds, made by one rule: legs of two links with servos, of any mass, step and cone.

`best_of_all` searches contacts of their feet by brute force, with hcbench's judge and not its search.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hcbench.engines.mujoco.model.drop_test import landing
from hcbench.engines.mujoco.model.foot_springs import FootContact, PairSearch
from hcbench.measuring.request import make_request
from hcbench.sim.landing import REBOUNDS, RobotDrop

_CORNERS = ((1.0, 0.6), (1.0, -0.6), (-1.0, 0.6), (-1.0, -0.6))
_MIDDLE = ((0.0, 0.8), (0.0, -0.8))
FREE = "<freejoint/>"
_RAIL = '<joint name="rail" type="slide" axis="0 0 1"/>'
_PLANE = '<joint name="x" type="slide" axis="1 0 0"/>' + _RAIL


@dataclass(frozen=True)
class Design:
    """A robot: a box on legs, each of two links with a servo above each.

    mass: kg, of which the box has about seven tenths. step: s. link: length of each, m. kp, kv: of
    the servos, SI. places: of the hips over the box, in units of `link`. base: joints of the box.
    foot: a geom at the end of each leg, with {i} for its number, {end} for the place under the knee,
    {radius} and {mass}.
    """

    name: str
    mass: float
    step: float
    cone: str
    link: float
    kp: float
    kv: float
    places: tuple[tuple[float, float], ...] = _CORNERS
    base: str = FREE
    integrator: str = "implicitfast"
    gravity: float = 9.81
    foot: str = '<geom name="foot{i}" type="sphere" size="{radius}" pos="0 0 {end}" mass="{mass}"/>'

    @property
    def pairs(self) -> list[str]:
        """Pairs of its feet with the floor."""
        return [f"foot{i},floor" for i in range(len(self.places))]

    @property
    def text(self) -> str:
        """The model as MJCF."""
        legs = "".join(self._leg(i, x, y) for i, (x, y) in enumerate(self.places))
        servos = "".join(
            f'<position joint="{joint}{i}" kp="{self.kp}" kv="{self.kv}"/>'
            for i in range(len(self.places))
            for joint in ("hip", "knee")
        )
        link = self.link
        return f"""<mujoco model="{self.name}"><compiler angle="degree"/>
<option timestep="{self.step}" cone="{self.cone}" integrator="{self.integrator}"
  gravity="0 0 -{self.gravity}"/>
<worldbody><geom name="floor" type="plane" size="9 9 .1"/>
<body name="trunk" pos="0 0 {2 * link}">{self.base}
<geom type="box" size="{link} {0.5 * link} {0.25 * link}" mass="{0.7 * self.mass}"/>{legs}</body>
</worldbody><actuator>{servos}</actuator></mujoco>"""

    def _leg(self, i: int, x: float, y: float) -> str:
        link, mass = self.link, self.mass
        joint = f'axis="0 1 0" damping="{0.05 * self.kv}" armature="{0.01 * mass * link**2}"'
        shape = f'type="capsule" fromto="0 0 0 0 0 {-link}" contype="0" conaffinity="0"'
        foot = self.foot.format(i=i, end=-link, radius=0.12 * link, mass=0.005 * mass)
        return f"""
<body pos="{x * link} {y * link} 0" euler="0 30 0"><joint name="hip{i}" {joint}/>
<geom {shape} size="{0.09 * link}" mass="{0.03 * mass}"/>
<body pos="0 0 {-link}" euler="0 -60 0"><joint name="knee{i}" {joint}/>
<geom {shape} size="{0.07 * link}" mass="{0.02 * mass}"/>{foot}</body></body>"""


_SOLE = (
    '<body pos="0 0 {end}" euler="0 30 0"><joint axis="0 1 0" stiffness="200" damping="8"/>'
    '<geom name="foot{i}" type="box" size=".1 .05 .015" pos=".02 0 0" mass=".4"/></body>'
)
_WHEEL = (
    '<body pos="0 0 {end}"><joint axis="0 1 0" damping=".05"/>'
    '<geom name="foot{i}" type="cylinder" size=".07 .02" euler="90 0 0" mass=".6"/></body>'
)

DESIGNS = (
    Design("small quadruped", 0.5, 1e-3, "elliptic", 0.06, 0.6, 0.01),
    Design("soft quadruped", 10.0, 2e-3, "elliptic", 0.2, 60.0, 2.0),
    Design("stiff quadruped", 10.0, 1e-3, "pyramidal", 0.2, 400.0, 8.0),
    Design("heavy quadruped", 40.0, 2e-3, "pyramidal", 0.3, 1200.0, 30.0),
    Design("hexapod", 5.0, 2e-3, "pyramidal", 0.12, 30.0, 0.6, places=(*_CORNERS, *_MIDDLE)),
    Design("slow hexapod", 8.0, 5e-3, "elliptic", 0.15, 60.0, 2.0, places=(*_CORNERS, *_MIDDLE)),
    Design("biped", 16.0, 2e-3, "pyramidal", 0.35, 500.0, 18.0, places=((0.0, 0.3), (0.0, -0.3)),
        foot=_SOLE),
    Design("hopper", 4.0, 1e-3, "elliptic", 0.25, 150.0, 4.0, places=((0.0, 0.0),), base=_RAIL),
    Design("wheeled leg", 12.0, 5e-3, "elliptic", 0.25, 250.0, 8.0, places=((0.0, 0.0),), base=_PLANE,
        foot=_WHEEL),
)  # fmt: skip


def best_of_all(design: Design, target: float, *, fast: int, damped: int) -> tuple[float, int]:
    """The rebound nearest to a target, m, of a grid of contacts that land no worse, and the number of
    contacts: far softer and stiffer, less and more damped, than any that a search tries.

    fast, damped: numbers of frequencies and of dampings, 0.02 to 12. Each contact has the model's
    own cone, and an elliptic one with impratio 10, and MuJoCo's impedance, and one that hardens.
    """
    requests = [make_request(pair) for pair in design.pairs]
    before = landing(design.text, requests, None)
    search = PairSearch(design.text, requests, before, target)
    speed = math.sqrt(2.0 * design.gravity * 0.1)
    frequencies = np.geomspace(0.08 * speed / before.depth, 1.0 / design.step, fast).tolist()
    dampings = np.geomspace(0.02, 12.0, damped).tolist()
    untuned = search.drop(None, 0.5, REBOUNDS)

    def is_no_worse(contact: FootContact, drops: Sequence[RobotDrop], *, touch: bool) -> bool:
        test = search.drop(contact, 0.5 if touch else before.seconds, drops)
        return not list(test.worse_than(untuned if touch else before, target))

    touching = []
    tried = 0
    for frequency, damping, impratio in itertools.product(frequencies, dampings, (0.0, 10.0)):
        for contact in search.kinds(FootContact(frequency, damping, impratio)):
            if not search.is_kept(contact):
                continue
            tried += 1
            # What is worse in one drop is worse in all.
            if all(is_no_worse(contact, [drop], touch=True) for drop in REBOUNDS):
                touching.append((search.drop(contact, 0.5, REBOUNDS).rebound, contact))
    for rebound, contact in sorted(touching, key=lambda one: abs(one[0] - target)):
        if abs(rebound - target) >= abs(before.rebound - target):
            break
        drops = reversed(search.bench.drops)
        if all(is_no_worse(contact, [drop], touch=False) for drop in drops):
            return rebound, tried
    return before.rebound, tried
