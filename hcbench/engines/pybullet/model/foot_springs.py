"""PyBullet: springs of a robot's feet by contactStiffness and contactDamping, tried in drops of the
robot and written as lines of a script.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import islice
from shlex import quote
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.pybullet.backend import MASS, STIFFNESS
from hcbench.engines.pybullet.model.causes import Call, apply_calls, script_of
from hcbench.engines.pybullet.model.drop_test import (
    FIRST_S,
    LASTING,
    Change,
    ChangedWorld,
    WorldDropBench,
)
from hcbench.engines.pybullet.model.open import BodyPart
from hcbench.engines.pybullet.model.under_test import PybulletModel, unwritten
from hcbench.sim.landing import DROPS, MANY_REBOUNDS, REBOUNDS, DropTest, ReboundSettings
from hcbench.sim.model_under_test import ModelSetting, Suspect, Texts
from hcbench.sim.rebound_search import FootSpring, ReboundSearch, SpringGrid, worse_of
from hcbench.system.text import joined_names

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from hcbench.engines.pybullet.model.open import LoadedWorld
    from hcbench.sim.landing import RobotDrop
    from hcbench.sim.model_under_test import Request

# Bullet's springs are implicit: they hold at any frequency, and damp the more the higher w h is.
_GRID = SpringGrid(
    fastest=1.5,
    frequencies=4,
    dampings=tuple(np.geomspace(0.03, 1.4, 5).tolist()),
    calming=tuple(np.geomspace(0.4, 4.0, 5).tolist()),
    first=LASTING[:1],
    first_seconds=FIRST_S,
    nearest_frequencies=7,
    nearest=2,
    very_nearest=1,
)
# Faster springs, which mostly land worse, are tried where these do not have the rebound. At ten times
# 1/h a spring stops a foot within a step, and a faster one changes nothing: the damping alone then
# tells which share of the penetration is taken back in a step.
_FASTEST = 10.0
# Their largest damping, and that of those that throw the robot up less.
_MORE_DAMPED = 3.7
_CALMER = 12.0
# Contacts that have the rebound and are dropped whole, and of those that come nearest, at most.
_MET = 4
_NEAREST = 16
# The whole test, in the order that finds the most contacts that land worse in the least time.
_ORDER = (LASTING[0], *(drop for drop in DROPS if drop not in LASTING), *LASTING[1:])
# A stiffness, N/m, that Bullet gives bodies without a spring: beside it the other's holds alone.
_STIFF = 1e18


class LinkSearch(ReboundSearch[FootSpring]):
    """Springs of a robot's feet, tried in drops in copies of its world.

    before, target: as of `ReboundSearch`. Raises UserError for a robot that cannot be dropped.
    """

    grid = _GRID

    def __init__(self, bench: WorldDropBench, before: DropTest, target: float) -> None:
        """Drop the robot as it is by the short drops, which show what its feet are."""
        self._robot = bench
        super().__init__(bench, before, target)

    def spring(self, frequency: float, damping: float) -> FootSpring:
        """The spring of a frequency, rad/s, and a ratio of damping."""
        return FootSpring(frequency, damping)

    def drop(
        self, spring: FootSpring | None, seconds: float, drops: Sequence[RobotDrop]
    ) -> DropTest:
        """Drop the robot, `seconds` s each, with the spring at its feet; None: with its own contacts."""
        if spring is None:
            return self._robot.test(seconds, drops)
        return self._robot.test_with(self._change(spring), seconds, drops)

    def contacts(self) -> Iterator[FootSpring]:
        """Yield those of `ReboundSearch`, and then those of faster springs."""
        yield from super().contacts()
        faster = self._frequencies(self.grid.nearest_frequencies)[self.grid.frequencies :]
        # Between those that land no worse alone: most land worse.
        yield from self._in_rows(self._feasible(self._row(frequency)) for frequency in faster)

    def _frequencies(self, count: int) -> list[float]:
        """Frequencies of springs to try, rad/s: those of the grid, and faster ones up to `count`."""
        slower = super()._frequencies(self.grid.frequencies)
        fastest = _FASTEST / self.bench.timestep
        more = count - len(slower)
        return [*slower, *np.geomspace(slower[-1], fastest, more + 1)[1:].tolist()]

    def _row(self, frequency: float) -> list[FootSpring]:
        """Springs of one frequency to try, the most damped first."""
        row = super()._row(frequency)
        if not self._is_faster(frequency):
            return row
        most_damped = _CALMER if self._dampings == self.grid.calming else _MORE_DAMPED
        return [self.spring(frequency, most_damped), *row]

    def _is_faster(self, frequency: float) -> bool:
        """Say whether a frequency, rad/s, is beyond those of the grid."""
        return frequency > 1.01 * self.grid.fastest / self.bench.timestep

    def _try(self, contact: FootSpring) -> DropTest:
        """The short drops of a contact; of a faster one that lands worse no more than that it does."""
        if contact not in self._tried and self._is_faster(contact.frequency):
            # Most land worse, and none of them is shown for its trade-offs.
            bench = self.dropped(contact)
            if bench.is_no_worse(self._untuned, self.target, self._short, REBOUNDS):
                self._tried[contact] = bench.test(self._short, REBOUNDS)
            else:
                self._tried[contact] = replace(self._untuned, peak=math.inf)
        return super()._try(contact)

    def dropped(self, spring: FootSpring) -> WorldDropBench:
        """The robot with the spring at its feet."""
        return self._robot.with_change(self._change(spring))

    def _change(self, spring: FootSpring) -> Change:
        """The change of a world that gives the spring to the feet."""
        return partial(apply_calls, calls=self.calls(spring))

    def _first_drops_are_no_worse(self, contact: FootSpring) -> bool:
        """Say so as `ReboundSearch`, by drops that end as soon as something is worse."""
        seconds = min(self.before.seconds, self.grid.first_seconds)
        bench = self.dropped(contact)
        for drop in self.grid.first:
            if drop not in self._allowed:
                self._allowed[drop] = worse_of(self.before, self.drop(None, seconds, [drop]))
            if not bench.is_no_worse(self._allowed[drop], self.target, seconds, [drop]):
                return False
        return True

    def meets_at_many_phases(self, bench: WorldDropBench) -> bool:
        """Say whether the rebound is the target at places in a step that the search did not see, in
        short drops.
        """
        return bench.test(self._short, MANY_REBOUNDS).meets(self.target)

    def lands_no_worse(self, bench: WorldDropBench) -> bool:
        """Say whether no drop of the whole test is worse than that of the model."""
        return bench.is_no_worse(self.before, self.target, self.before.seconds, _ORDER)

    @property
    def feet(self) -> list[int]:
        """Links of the pairs; where these name a whole body, those that the floor pushed."""
        return sorted(self._robot.feet or self._robot.seen)

    @property
    def others(self) -> list[str]:
        """Names of links that land on the floor, too, and are of no pair."""
        world = self._robot.world
        return [
            world.name_of(self._robot.number, link)
            for link in sorted(self._robot.seen - set(self.feet))
        ]

    def calls(self, spring: FootSpring) -> list[Call]:
        """The calls of PyBullet that give the spring to each point of the feet.

        The robot's mass, over the points at which the floor pushed at once, oscillates at w.
        """
        mass = self._robot.mass / self._robot.points
        stiffness = float(f"{mass * spring.frequency**2:.5g}")
        damping = float(f"{2.0 * spring.damping * spring.frequency * mass:.5g}")
        settings = {"contactStiffness": stiffness, "contactDamping": damping}
        world = self._robot.world
        number = self._robot.number
        calls = []
        for link in self.feet:
            foot = BodyPart(world.name_of(number), number, link)
            calls.append(Call(settings, foot))
        return [*calls, *_without_springs(world)]


def _without_springs(world: LoadedWorld) -> Iterator[Call]:
    """Calls that make the springs of fixed links, which act in series with the feet's, so stiff that
    only the feet's count; none for links without a spring.
    """
    bullet = world.bullet
    for body in bullet.bodies():
        for link in range(-1, bullet.getNumJoints(body)):
            has_spring = bullet.getDynamicsInfo(body, link)[STIFFNESS] > 0.0
            if has_spring and not bullet.getDynamicsInfo(body, -1)[MASS] > 0.0:
                side = BodyPart(world.name_of(body), body, link)
                yield Call({"contactStiffness": _STIFF, "contactDamping": 0.0}, side)


def rebound_settings(
    build: Callable[[], LoadedWorld],
    requests: Sequence[Request],
    before: DropTest,
    target: float,
) -> ReboundSettings:
    """Settings of a robot's feet with which its centre of mass rebounds to the target, found by
    drops of the robot; each search runs as its settings are asked for.

    build: opens the world.
    requests: of the feet's pairs.
    before: the whole test of the world as it is.
    target: the rebound, m.
    Raises UserError for what cannot be dropped.
    """
    search = LinkSearch(WorldDropBench(build(), requests), before, target)

    def setting(spring: FootSpring, dropped: WorldDropBench | None = None) -> ModelSetting:
        """A spring as a setting. dropped: the robot with it, where it was dropped."""
        return _setting(build, search, spring, requests[0], dropped)

    def meeting() -> Iterator[ModelSetting]:
        """Settings that have the rebound at more phases than the search saw, and land no worse."""
        for spring in islice(search.contacts(), _MET):
            dropped = search.dropped(spring)
            if search.meets_at_many_phases(dropped) and search.lands_no_worse(dropped):
                yield setting(spring, dropped)

    def nearest() -> Iterator[ModelSetting]:
        """Settings nearest to the rebound that land no worse."""
        for spring in islice(search.nearest_contacts(), _NEAREST):
            dropped = search.dropped(spring)
            if search.lands_no_worse(dropped):
                yield setting(spring, dropped)

    return ReboundSettings(
        meeting(),
        nearest(),
        map(setting, search.trading_contacts()),
        search.stiffer,
        _all_feet(search, requests),
    )


def _all_feet(search: LinkSearch, requests: Sequence[Request]) -> tuple[str, ...]:
    """A sentence where links that no pair names land on the floor, with the options that name all;
    else none. A spring of one foot of four hardly changes how the robot lands.
    """
    others = search.others
    pairs = [request.pair for request in requests if request.pair]
    if not others or not pairs:
        return ()
    _, floor = pairs[0]
    every = [*pairs, *((link, floor) for link in others)]
    options = " ".join(f"--pair {quote(joined_names(pair))}" for pair in every)
    return (f"Other links land on the floor, too: {', '.join(others)}. Name them all: {options}.",)


def _setting(
    build: Callable[[], LoadedWorld],
    search: LinkSearch,
    spring: FootSpring,
    request: Request,
    dropped: WorldDropBench | None,
) -> ModelSetting:
    """A spring of the feet as a setting of a user's world: notes, lines and the world with it.

    request: with the step and gravity of the drops.
    dropped: the robot with the spring, where it was dropped.
    """
    calls = search.calls(spring)
    notes = [
        "contactStiffness, N/m, and contactDamping, N s/m, act at each point of contact.",
        "Friction and masses are as they were; the rebound holds with them, in this pose with these "
        "motors.",
        *unwritten(request),
    ]
    if search.others:
        notes.append(f"{', '.join(search.others)} land on the floor, too, and keep their contact.")

    sides = [call.side for call in calls if call.side is not None]
    text = script_of([call.text for call in calls], sides)
    apply = partial(apply_calls, calls=calls)

    def opened(request: Request) -> PybulletModel:
        return PybulletModel(build(), build, request, [Suspect("feet", "", "", text, apply)])

    return ModelSetting(
        "feet as springs",
        tuple(notes),
        opened,
        lambda *_: Texts(text),
        source=ChangedWorld(build, apply, dropped),
    )
