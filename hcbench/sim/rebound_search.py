"""Searches contacts of a robot's feet for a rebound of its centre of mass, by drops of the robot.

All feet have one contact: a damped spring, whose rebound is smooth in frequency and damping.
"""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from hcbench.sim.landing import QUANTITIES, REBOUNDS

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from hcbench.sim.drop_test import DropBench
    from hcbench.sim.landing import DropTest, RobotDrop


@dataclass(frozen=True, slots=True)
class FootSpring:
    """A contact of the feet in the coordinates in which the rebound of a robot is smooth.

    frequency: w, rad/s.
    damping: ζ, the ratio of damping.
    """

    frequency: float
    damping: float


Spring = TypeVar("Spring", bound=FootSpring)


@dataclass(frozen=True, slots=True)
class SpringGrid:
    """Springs that are tried: `frequencies` of them, from somewhat below that of a body which stops
    within the depth allowed, up to `fastest` over the time step.

    dampings: ζ of springs that throw a robot up higher than its model does, rising.
    calming: of those that throw it up less.
    first: drops by which a spring is first judged whole, of a robot that stands, for first_seconds
    each, s, or as long as the model was.
    nearest_frequencies: as `frequencies`, for the springs that come nearest to a target out of
    reach.
    nearest: number of them that are refined in damping, one a frequency.
    very_nearest: of those, that are refined in frequency too.
    """

    fastest: float
    frequencies: int
    dampings: tuple[float, ...]
    calming: tuple[float, ...]
    first: tuple[RobotDrop, ...]
    first_seconds: float
    nearest_frequencies: int
    nearest: int
    very_nearest: int


# Share of the frequency of a body that stops within the depth allowed, from which springs are tried.
_SLOWER = 0.6
# Time of a short drop after the fall, s: the touch and the start of the flight.
_TOUCH_S = 0.35
# Halvings of the damping between two springs, and how near the rebound comes then.
_HALVINGS = 6
_NEAR = 0.03
# Halvings of an interval beyond the spring that was found nearest to the target: of the damping of
# the nearest ones, then of the frequency, and the damping again, of the very nearest.
_REFINED = 3
_SETTINGS_MAX = 12


class ReboundSearch(ABC, Generic[Spring]):
    """Contacts of the feet of a robot, tried in drops of it.

    before: the whole test of the model as it is.
    target: rebound, m; 0 for none.
    grid: of the springs to try.
    bench: the robot; an engine's `drop` sets the contacts of its feet.
    A short drop ends soon after the touch: it tells the rebound, and not how the robot comes to
    rest.
    """

    grid: SpringGrid

    def __init__(self, bench: DropBench, before: DropTest, target: float) -> None:
        """Begin the search, with short drops of the model as it is to compare with.

        bench: drops the robot.
        before: its whole test as it is.
        target: rebound, m; 0 for none. Short drops end _TOUCH_S after the touch.
        """
        self.bench = bench
        self.before = before
        self.target = target
        fall = math.sqrt(2.0 * REBOUNDS[0].height / bench.gravity)
        self._short = fall + _TOUCH_S
        # The depth by which a setting is judged to land no deeper than the model, m.
        self.deepest = max(1.2 * before.depth, before.depth + 5e-4)
        self._tried: dict[Spring, DropTest] = {}
        # First drops, each with all that a contact may do in it.
        self._allowed: dict[RobotDrop, DropTest] = {}
        self._untuned = self.drop(None, self._short, REBOUNDS)
        is_lower = target < before.rebound
        self._dampings = self.grid.calming if is_lower else self.grid.dampings

    @abstractmethod
    def spring(self, frequency: float, damping: float) -> Spring:
        """The contact of a frequency, rad/s, and a ratio of damping."""

    @abstractmethod
    def drop(self, spring: Spring | None, seconds: float, drops: Sequence[RobotDrop]) -> DropTest:
        """Drop the robot with a contact of its feet; None: with its own. seconds: of each drop."""

    def is_kept(self, spring: Spring) -> bool:
        """Say whether the engine takes a contact as it is written."""
        return True

    def variants(self, spring: Spring) -> Iterable[Spring]:
        """The contact, and others with the same spring that may land better."""
        return (spring,)

    def kinds(self, spring: Spring) -> tuple[Spring, ...]:
        """The contact, and others of the same frequency and damping that throw a robot otherwise: each
        kind has rows of its own.
        """
        return (spring,)

    def stop(self, damping: float) -> float:
        """Way in which a spring of this ratio of damping stops a body, over that without damping; an
        engine that tries no softer springs with more damping leaves it at 1.
        """
        return 1.0

    def stiffer(self) -> tuple[tuple[float, float], ...]:
        """(factor of kp, rebound, m) of stiffer servos that were tried, see `Reach`; () where an engine
        tries none.
        """
        return ()

    def contacts(self) -> Iterator[Spring]:
        """Yield contacts whose rebound is the target in short drops and whose first long drops are
        not worse than the model's, the most promising first; each with its variants.

        The drops of a contact are made when it is asked for.
        """
        return self._in_rows(self._rows())

    def _in_rows(self, rows: Iterable[Sequence[Spring]]) -> Iterator[Spring]:
        """Yield them from rows of contacts, each of one frequency and the most damped first."""
        met = []
        for row in rows:
            met += self._meeting(row)
        met.sort(key=self._promise)
        for contact in met[:_SETTINGS_MAX]:
            for varied in self.variants(contact):
                if self._first_drops_are_no_worse(varied):
                    yield varied

    def nearest_contacts(self) -> Iterator[Spring]:
        """Yield contacts that are not worse in short drops and in the first long ones, and whose
        rebound is nearer to the target than the model's, the nearest first: of each frequency the
        nearest, and those that are refined in damping and frequency.
        """
        frequencies = self._frequencies(self.grid.nearest_frequencies)
        nearest = self._nearest_of(frequencies)
        refined = sorted(map(self._by_damping, nearest), key=self._miss)
        very_nearest = refined[: self.grid.very_nearest]
        moved = (self._by_frequency(one, frequencies) for one in very_nearest)
        again = [self._by_damping(one) for one in moved]
        # Those at the edge of what lands no worse may fail in more drops: the others come after them.
        yield from sorted(dict.fromkeys([*again, *refined, *nearest]), key=self._miss)

    def trading_contacts(self) -> Iterator[Spring]:
        """Yield contacts that were tried whose rebound is nearer to the target than the model's,
        even if something lands worse with them: first those that make the fewest quantities worse
        in short drops, then the nearest.
        """
        miss = abs(self.before.rebound - self.target)
        tried = {one: test for one, test in self._tried.items() if not test.diverged}
        nearer = [one for one in tried if self._miss(one) < miss]

        def cost(contact: Spring) -> tuple[int, float]:
            worse = list(tried[contact].worse_than(self._untuned, self.target))
            return len(worse), self._miss(contact)

        yield from sorted(nearer, key=cost)

    def _nearest_of(self, frequencies: Sequence[float]) -> list[Spring]:
        """Contacts, one of each frequency, whose rebound is nearest to the target, if it is nearer
        than the model's and neither short drops nor first long ones are worse; the nearest first,
        `grid.nearest` of them at most.

        frequencies: w of the springs, rad/s.
        """
        own = abs(self._untuned.rebound - self.target)
        rows = (self._feasible(self._row(frequency)) for frequency in frequencies)
        nearest: dict[float, Spring] = {}
        for contact in sorted(itertools.chain.from_iterable(rows), key=self._miss):
            if len(nearest) == self.grid.nearest or self._miss(contact) >= own:
                break
            if contact.frequency not in nearest and self._first_drops_are_no_worse(contact):
                nearest[contact.frequency] = contact
        return list(nearest.values())

    def _miss(self, contact: Spring) -> float:
        """Distance of its rebound from the target in short drops, m."""
        return abs(self._misses(contact))

    def _by_damping(self, contact: Spring) -> Spring:
        """The contact with its damping moved towards the grid's next one, on the side on which the
        target lies, as far as it comes nearer and lands no worse: more damping, less rebound.
        """
        if self._misses(contact) > 0.0:
            beyond = min((one for one in self._dampings if one > contact.damping), default=None)
        else:
            beyond = max((one for one in self._dampings if one < contact.damping), default=None)
        return contact if beyond is None else self._towards(contact, "damping", beyond)

    def _by_frequency(self, contact: Spring, frequencies: Sequence[float]) -> Spring:
        """Move the frequency of a contact towards its neighbours in a list, as far as the contact comes
        nearer to the target and lands no worse: softer springs throw a robot higher, and let it
        sink deeper.

        frequencies: rad/s, rising; that of the contact is one of them.
        """
        at = frequencies.index(contact.frequency)
        for beyond in (*frequencies[max(at - 1, 0) : at], *frequencies[at + 1 : at + 2]):
            contact = self._towards(contact, "frequency", beyond)
        return contact

    def _towards(self, contact: Spring, name: str, beyond: float) -> Spring:
        """The contact with one number moved towards another value as far as it comes nearer to the
        target and does not land worse, found by halving the interval _REFINED times.

        name: "frequency", rad/s, or "damping", a ratio.
        beyond: the other value of it. Halved is the ratio of the two values: the middle is their
        geometric mean.
        """
        for _ in range(_REFINED):
            middle = replace(contact, **{name: math.sqrt(getattr(contact, name) * beyond)})
            if self._is_nearer(middle, contact) and self._first_drops_are_no_worse(middle):
                contact = middle
            else:
                beyond = getattr(middle, name)
        return contact

    def _is_nearer(self, one: Spring, other: Spring) -> bool:
        """Say whether one contact is nearer to the target in short drops than another, and no worse."""
        if not self.is_kept(one) or not self._is_no_worse(self._try(one)):
            return False
        return self._miss(one) < self._miss(other)

    def largest_of_few(self) -> float:
        """The largest rebound of a coarse grid of contacts that are not worse in short drops, m."""
        self._tried.clear()
        every = itertools.chain.from_iterable(row[::2] for row in self._rows()[::2])
        rebounds = [self._try(contact).rebound for contact in self._feasible(every)]
        self._tried.clear()
        return max(rebounds, default=0.0)

    def _rows(self) -> list[list[Spring]]:
        """Contacts to try: for each frequency, rising, a list of each kind, the most damped first.

        A spring of frequency w stops a speed v within v/w. Contacts that the engine does not keep
        are left out.
        """
        rows = []
        for frequency in self._frequencies(self.grid.frequencies):
            kept = [self.kinds(contact) for contact in self._row(frequency)]
            rows += [list(of_kind) for of_kind in zip(*kept, strict=True)]
        return rows

    def _frequencies(self, count: int) -> list[float]:
        """Frequencies of the contacts to try, rad/s, rising: `count` of them, evenly in ratio.

        The highest is the grid's `fastest` over the time step, the lowest that of the most damped
        spring, see `_slowest`.
        """
        fastest = self.grid.fastest / self.bench.timestep
        slowest = self._slowest(self._dampings[-1])
        frequencies: list[float] = np.geomspace(slowest, fastest, count).tolist()
        return frequencies

    def _slowest(self, damping: float) -> float:
        """The lowest frequency, rad/s, of a spring that is tried with a ratio of damping: _SLOWER of
        that which stops a body within the depth allowed, at least 10 rad/s and at most half the
        highest of all.
        """
        speed = math.sqrt(2.0 * self.bench.gravity * REBOUNDS[0].height)
        slowest = max(10.0, _SLOWER * self.stop(damping) * speed / self.deepest)
        return min(slowest, 0.5 * self.grid.fastest / self.bench.timestep)

    def _row(self, frequency: float) -> list[Spring]:
        """Contacts of one frequency to try, see `_rows`."""
        row = []
        for damping in reversed(self._dampings):
            contact = self.spring(frequency, damping)
            # The frequency of a whole row may be rounded below the lowest one.
            is_fast = frequency > 0.999 * self._slowest(damping)
            if is_fast and self.is_kept(contact):
                row.append(contact)
        return row

    def _feasible(self, contacts: Iterable[Spring]) -> list[Spring]:
        """Those that are not worse in short drops."""
        return [contact for contact in contacts if self._is_no_worse(self._try(contact))]

    def _is_no_worse(self, test: DropTest) -> bool:
        return not list(test.worse_than(self._untuned, self.target))

    def _try(self, contact: Spring) -> DropTest:
        """The short drops of a contact; the first alone where something is worse in it than in all of
        the model's: others make it no better.
        """
        if contact not in self._tried:
            first = self.drop(contact, self._short, REBOUNDS[:1])
            is_worse = not self._is_no_worse(first)
            self._tried[contact] = first if is_worse else self.drop(contact, self._short, REBOUNDS)
        return self._tried[contact]

    def _meeting(self, row: Sequence[Spring]) -> list[Spring]:
        """Contacts of one frequency that have the target's rebound in short drops, and with which
        nothing is worse.

        row: contacts of the frequency, the most damped first. Between two neighbours whose rebounds
        are below and above the target, one that has it is searched; for a target of 0 the row
        itself is tried.
        """
        if not self.target:
            return [contact for contact in row if self._is_met(contact)]
        met = []
        for high, low in itertools.pairwise(row):
            if (self._misses(high) > 0.0) != (self._misses(low) > 0.0):
                between = self._between(high, low)
                if self._is_met(between):
                    met.append(between)
        return met

    def _between(self, above: Spring, below: Spring) -> Spring:
        """A contact whose rebound misses the target by less than _NEAR of it, found by halving the
        interval of damping between two; or the last one tried.

        above, below: two contacts of one frequency, with rebounds on different sides of the target.
        """
        middle = above
        for _ in range(_HALVINGS):
            middle = replace(above, damping=math.sqrt(above.damping * below.damping))
            if abs(self._misses(middle)) < _NEAR * self.target:
                break
            if (self._misses(middle) > 0.0) == (self._misses(above) > 0.0):
                above = middle
            else:
                below = middle
        return middle

    def _is_met(self, contact: Spring) -> bool:
        """Say whether a contact has the target's rebound in short drops, and is not worse."""
        test = self._try(contact)
        return test.meets(self.target) and self._is_no_worse(test)

    def _misses(self, contact: Spring) -> float:
        """Rebound beyond the target, m; infinite where it diverges."""
        return self._try(contact).rebound - self.target

    def _promise(self, contact: Spring) -> float:
        """Less is better: force, depth and chance beside those of the model as it is."""
        test = self._try(contact)
        force = test.peak / max(self._untuned.peak, 1.0)
        depth = test.depth / max(self._untuned.depth, 1e-3)
        chance = test.spread / max(self.target, 1e-3)
        return force + depth + chance

    def _first_drops_are_no_worse(self, contact: Spring) -> bool:
        """Say whether no first drop of a contact is worse than the same drop of the model as it is, or
        than all that its whole test allows: a robot still creeps after a shorter drop.
        """
        seconds = min(self.before.seconds, self.grid.first_seconds)
        for drop in self.grid.first:
            if drop not in self._allowed:
                as_it_is = self.drop(None, seconds, [drop])
                self._allowed[drop] = worse_of(self.before, as_it_is)
            dropped = self.drop(contact, seconds, [drop])
            if list(dropped.worse_than(self._allowed[drop], self.target)):
                return False
        return True


def worse_of(one: DropTest, other: DropTest) -> DropTest:
    """The first of two tests, with the larger value of both in each quantity; NaN does not count."""
    worst: dict[str, Any] = {}
    for each in QUANTITIES:
        values = getattr(one, each.name), getattr(other, each.name)
        worst[each.name] = float(np.fmax(*values))
    return replace(one, **worst)
