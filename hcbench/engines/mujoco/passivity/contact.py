"""A contact that is tried in plain models of MuJoCo, and the options under which it is."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.backend import backend

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from hcbench.terms.setting import Pair

# Half an edge of a box, m.
HALF = 0.05


@dataclass(frozen=True, slots=True)
class Stepping:
    """Options under which a plain model is simulated."""

    integrator: str = "Euler"
    cone: str = "elliptic"
    solver: str = "Newton"

    def __str__(self) -> str:
        return f"{self.integrator}, {self.cone}, {self.solver}"


@dataclass(frozen=True, slots=True)
class Contact:
    """A contact that is tried in plain models.

    option: attributes of <option> that it asks for.
    text: what to paste for pairs of geoms.
    gravity: m/s², in which bodies rest: the standard one where the scene has none.
    radius: of the ball, m.
    falls: gravity of the scene, m/s².
    friction: Coulomb's μ of the two geoms.
    """

    timestep: float
    gravity: float
    option: Mapping[str, str]
    text: Callable[[Sequence[Pair]], str]
    radius: float
    falls: float = 0.0
    friction: float = 0.0

    def model(self, bodies: str, options: Stepping, pairs: Sequence[Pair]) -> Any:
        """A compiled model of a plane and these bodies, whose `pairs` have the contact.

        bodies: <body> elements of MJCF. options: the plain model's; those of `option` win.
        pairs: names of two geoms each; the plane's is "plate".
        """
        plain = {"timestep": repr(self.timestep), "cone": options.cone, "solver": options.solver}
        option = " ".join(f'{key}="{value}"' for key, value in {**plain, **self.option}.items())
        integrator = f'integrator="{options.integrator}" gravity="0 0 {-self.gravity!r}"'
        return backend().MjModel.from_xml_string(
            f"<mujoco><option {option}/><option {integrator}/><worldbody>"
            f'<geom name="plate" type="plane" size="9 9 1"/>{bodies}</worldbody>'
            f"{self.text(pairs)}</mujoco>"
        )

    def with_ball(self, options: Stepping, joint: str = "<freejoint/>") -> Any:
        """A plain model of a ball on the plane."""
        shape = f'type="sphere" size="{self.radius!r}" mass="0.5"'
        place = f'name="ball" pos="0 0 {self.radius!r}"'
        body = f'<body {place}>{joint}<geom name="ball" {shape}/></body>'
        return self.model(body, options, [("ball", "plate")])

    def with_boxes(self, options: Stepping, count: int = 1) -> Any:
        """A plain model of `count` boxes of edge 2 HALF, 0.5 kg each, one on top of the other."""
        names = [f"box{i}" for i in range(count)]
        bodies = ""
        for i, name in enumerate(names):
            height = (2 * i + 1) * HALF
            bodies += f'<body name="{name}" pos="0 0 {height!r}"><freejoint/>'
            bodies += (
                f'<geom name="{name}" type="box" size="{HALF} {HALF} {HALF}" mass="0.5"/></body>'
            )
        return self.model(bodies, options, list(itertools.pairwise(["plate", *names])))
