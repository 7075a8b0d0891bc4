"""A user's PyBullet world whose pair has another restitution and friction."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from hcbench.engines.pybullet.model.causes import restitutions
from hcbench.engines.pybullet.model.under_test import PybulletModel, loaded, require_plausible
from hcbench.sim.capabilities import VariedContact
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from hcbench.sim.model_under_test import Request

# Places in getDynamicsInfo, by parameter, and the keywords of changeDynamics.
_KEYWORDS = {"restitution": (5, "restitution"), "friction": (1, "lateralFriction")}


class VariedWorld(VariedContact):
    """A world that is made again for each row.

    Bullet multiplies the numbers of the two bodies. The second keeps its own, unless that is 0.
    """

    parameters = tuple(_KEYWORDS)

    def __init__(
        self, source: Any, request: Request, rebuild: Callable[[], Any] | None = None
    ) -> None:
        """Load the world once, to see that it can be made again.

        source, rebuild: see `under_test.open_world`. Raises UserError for a live client, and
        SceneError for files that do not load.
        """
        world, build = loaded(source, rebuild, request.packages)
        if world.disconnect:
            world.bullet.disconnect()
        if build is None:
            got = "a live client, which cannot be made again"
            raise UserError("model", got, "a function that makes it")
        self._build = build

    def open(self, request: Request, values: Mapping[str, float]) -> PybulletModel:
        """A new world whose pair has the products of `values`."""
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
    """Give a pair the product of a number of its two bodies. Raises UserError for bodies with
    maximal coordinates, whose numbers PyBullet does not report.
    """
    place, bullet = model.place, model.bullet
    number, keyword = _KEYWORDS[name]
    if math.isnan(math.prod(restitutions(bullet, place))):
        raise UserError("vary", f"{name} of bodies with maximal coordinates", "multibodies")
    second = float(bullet.getDynamicsInfo(place.second.body, place.second.link)[number])
    if second == 0.0:
        second = 1.0
        bullet.changeDynamics(place.second.body, place.second.link, **{keyword: second})
    bullet.changeDynamics(place.first.body, place.first.link, **{keyword: product / second})
