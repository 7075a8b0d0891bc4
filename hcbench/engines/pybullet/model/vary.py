"""A user's PyBullet world whose pair has another restitution and friction."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hcbench.engines.pybullet.backend import LATERAL_FRICTION, RESTITUTION
from hcbench.engines.pybullet.model.causes import restitutions
from hcbench.engines.pybullet.model.under_test import PybulletModel, loaded, require_plausible
from hcbench.sim.capabilities import VariedContact
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from hcbench.sim.model_under_test import Request

# By parameter: its place in getDynamicsInfo, and its keyword of changeDynamics.
_KEYWORDS = {
    "restitution": (RESTITUTION, "restitution"),
    "friction": (LATERAL_FRICTION, "lateralFriction"),
}


class VariedWorld(VariedContact):
    """A world that is made again for each row.

    Bullet multiplies the numbers of the two bodies. The second keeps its own, unless that is 0.
    """

    parameters = tuple(_KEYWORDS)

    def __init__(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> None:
        """Load the world once, to see that it can be made again.

        source: files (paths), a `World`, or a client.
        rebuild: makes the `World` or client again; None where no function built it.
        Raises UserError for a live client, and SceneError for files that do not load.
        """
        world, build = loaded(source, rebuild, request.packages)
        if world.disconnect:
            world.bullet.disconnect()
        if build is None:
            got = "a live client, which cannot be made again"
            raise UserError("model", got, "a function that makes it")
        self._build = build

    def open(self, request: Request, values: Mapping[str, float]) -> PybulletModel:
        """The model under test of a new world in which the pair has other coefficients.

        values: "restitution" or "friction" -> product of the two bodies' coefficients.
        Raises what opening a model raises; UserError for bodies with maximal coordinates, whose
        numbers PyBullet does not report; SceneError and QuantityError for coefficients that no
        contact has.
        """
        model = PybulletModel(self._build(), self._build, request)
        try:
            for name, value in values.items():
                _set(model, name, value)
            require_plausible(model.bullet, model.place)
        except BaseException:
            model.close()
            raise
        return model


def _set(model: PybulletModel, name: str, product: float) -> None:
    """Change the first body's restitution or friction so that its product with the second's is
    `product`; where the second's is 0, it becomes 1.

    name: "restitution" or "friction".
    Raises UserError for bodies with maximal coordinates, whose numbers PyBullet does not report.
    """
    bullet = model.bullet
    first = model.place.first
    second = model.place.second
    index, keyword = _KEYWORDS[name]
    if math.isnan(math.prod(restitutions(bullet, model.place))):
        raise UserError("vary", f"{name} of bodies with maximal coordinates", "multibodies")
    of_second = float(bullet.getDynamicsInfo(second.body, second.link)[index])
    if of_second == 0.0:
        of_second = 1.0
        bullet.changeDynamics(second.body, second.link, **{keyword: of_second})
    bullet.changeDynamics(first.body, first.link, **{keyword: product / of_second})
