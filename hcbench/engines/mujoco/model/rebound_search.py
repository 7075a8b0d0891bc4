"""Searches contacts of a robot's feet for a rebound of its centre of mass, by drops of the robot.

All feet have one contact: a damped spring, whose rebound is smooth in frequency and damping.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import explicit_pairs
from hcbench.engines.mujoco.model.drop_test import DropBench
from hcbench.engines.mujoco.model.find_pair import named_pair
from hcbench.engines.mujoco.model.open import load
from hcbench.engines.mujoco.model.under_test import MujocoModel
from hcbench.engines.mujoco.model.write_pairs import (
    Written,
    colliding_geoms,
    contact_text,
    elliptic_option,
    friction_values,
    label_of,
    name_geoms,
    set_pair,
    spec_of,
    taken_pairs,
    texts_of,
)
from hcbench.sim.landing import DROPS, REBOUNDS, DropTest, ReboundSettings
from hcbench.sim.model_under_test import ModelSetting, Texts

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from hcbench.sim.model_under_test import ModelUnderTest, Output, Request
    from hcbench.sim.promise import Promise

    Geoms = tuple[int, int]

# MuJoCo's own impedance: with it solref alone makes the contact.
SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
# MuJoCo raises a shorter time constant to so many steps.
_LEAST_STEPS = 2.0


@dataclass(frozen=True, slots=True)
class FootContact:
    """A contact in the coordinates in which the rebound of a robot is smooth.

    frequency: w = 1/(timeconst dampratio), rad/s. damping: ζ, the dampratio. impratio: of the whole
    model, with elliptic cones; 0 for the model's own cone and impratio.
    """

    frequency: float
    damping: float
    impratio: float = 0.0

    @property
    def solref(self) -> tuple[float, float]:
        """MuJoCo's timeconst, s, and dampratio, in the digits that are written."""
        return (
            float(f"{1.0 / (self.frequency * self.damping):.5g}"),
            float(f"{self.damping:.5g}"),
        )

    def is_kept(self, timestep: float) -> bool:
        """Say whether MuJoCo keeps the time constant at a step, s."""
        return self.solref[0] >= _LEAST_STEPS * timestep


def foot_geoms(model: Any, requests: Sequence[Request]) -> list[Geoms]:
    """All pairs of geoms of the pairs of the requests that MuJoCo collides, by their numbers.

    requests: each with the names of its pair. Raises UserError for unknown names, and for more
    geoms than can be written.
    """
    pairs = []
    for request in requests:
        assert request.pair is not None
        pairs.append(named_pair(model, request.pair))
    return colliding_geoms(model, pairs)


def set_contact(model: Any, plain: Any, geoms: Sequence[Geoms], contact: FootContact) -> None:
    """Write a contact of the feet into the <pair>s of geoms in a compiled model, and its cone and
    impratio into the model's options.

    model: changed. plain: the model as it is, whose cone and impratio hold where the contact has
    none. geoms: numbers, two and two.
    """
    for both in geoms:
        for number in explicit_pairs(model, both):
            model.pair_solref[number] = contact.solref
            model.pair_solimp[number] = SOLIMP
    model.opt.cone = plain.opt.cone
    model.opt.impratio = plain.opt.impratio
    if contact.impratio:
        model.opt.cone = int(backend().mjtCone.mjCONE_ELLIPTIC)
        model.opt.impratio = contact.impratio


def write_contact(source: Any, requests: Sequence[Request], contact: FootContact) -> Written:
    """The model of a source with the contact in <pair>s of all feet, in a spec of its own;
    friction, condim and margin stay.

    source: a file, MJCF text or an MjSpec. requests: each with the names of a foot and its floor.
    Raises UserError for a source that cannot be written, for unknown pairs and for too many geoms.
    """
    spec = spec_of(source)
    model = spec.compile()
    geoms = foot_geoms(model, requests)
    notes: list[str] = []
    names = name_geoms(spec, model, geoms, notes)
    own = not notes and not taken_pairs(model, geoms)
    lines = []
    for one, other in geoms:
        both = (names[one], names[other])
        known = [pair for pair in spec.pairs if {pair.geomname1, pair.geomname2} == set(both)]
        values: dict[str, Any] = {"solref": list(contact.solref), "solimp": list(SOLIMP)}
        if not known:
            values |= friction_values(model, (one, other))
            if model.geom_margin[[one, other]].any():
                values |= {"margin": _onset(model, one, other), "gap": 0.0}
        elements = known or [spec.add_pair(geomname1=both[0], geomname2=both[1])]
        lines += [set_pair(element, both, values) for element in elements]
    option = ""
    if contact.impratio:
        option = elliptic_option(spec, contact.impratio, "feet slip less", notes)
    return Written(spec, contact_text(option, lines), notes, names, own)


def _onset(model: Any, one: int, other: int) -> float:
    """Distance from which the contact of two geoms acts, m.

    one, other: numbers of the geoms in a compiled model. Versions of MuJoCo join margins and gaps
    in different ways: two spheres with those show it.
    """
    spec = backend().MjSpec()
    for geom in (one, other):
        body = spec.worldbody.add_body()
        body.add_freejoint()
        margin = float(model.geom_margin[geom])
        gap = float(model.geom_gap[geom])
        body.add_geom(type=backend().mjtGeom.mjGEOM_SPHERE, size=[1, 0, 0], margin=margin, gap=gap)
    compiled = spec.compile()
    data = backend().MjData(compiled)
    backend().mj_forward(compiled, data)
    return float(data.contact.includemargin[0])


# Contacts that are tried: frequencies from that of a body which stops within the depth allowed, and
# up to this share of 1/h; and dampings, which throw a robot up higher than its model does, or less.
_SLOWER = 0.6
_FASTEST = 0.4
_FREQUENCIES = 8
_DAMPINGS = tuple(np.geomspace(0.12, 1.4, 8).tolist())
_CALMING = tuple(np.geomspace(0.4, 4.0, 8).tolist())
# Time of a short drop after the fall, s: the touch and the start of the flight.
_TOUCH_S = 0.35
# Halvings of the damping between two contacts, and how near the rebound comes then.
_HALVINGS = 6
_NEAR = 0.03
# Halvings of the damping beyond the rebound that was found nearest to the target.
_REFINED = 3
# Impratios with elliptic cones that are tried for less slip; 0 is the model's own.
_IMPRATIOS = (0.0, 10.0)
# Drops by which a contact is first judged whole, of a robot that stands.
_FIRST = (DROPS[-1], DROPS[len(DROPS) // 2])
_SETTINGS_MAX = 12
_NEAREST_MAX = 8
# Factors of the servos' kp, with their square roots of kd, by which more is tried.
_STIFFER = (2.0, 4.0, 8.0, 16.0)
# Fewer iterations of the solver do not hold a foot.
_ITERATIONS = 20


class ReboundSearch:
    """Contacts of the feet of a robot, tried in drops of it.

    source: a file, MJCF text or an MjSpec. requests: of the feet's pairs. before: the whole test of
    the model as it is. target: rebound, m; 0 for none.
    A short drop ends soon after the touch: it tells the rebound, and not how the robot comes to
    rest.

    Raises UserError for a robot that cannot be dropped or a model that cannot be written.
    """

    def __init__(
        self, source: Any, requests: Sequence[Request], before: DropTest, target: float
    ) -> None:
        """Write a contact into a copy of the model, and drop the model as it is by the short drops."""
        self.before = before
        self.target = target
        self.plain = spec_of(source).compile()
        self.geoms = foot_geoms(self.plain, requests)
        label = label_of(source)
        # With <pair>s, whose numbers the search sets.
        first = write_contact(source, requests, FootContact(100.0, 1.0))
        self.bench = DropBench(first.spec, label, requests)
        fall = math.sqrt(2.0 * REBOUNDS[0].height / self.bench.gravity)
        self._short = fall + _TOUCH_S
        self._tried: dict[FootContact, DropTest] = {}
        # The same drops of the model as it is.
        self._untuned = DropBench(spec_of(source), label, requests).test(self._short, REBOUNDS)
        self._dampings = _CALMING if target < before.rebound else _DAMPINGS

    def contacts(self) -> Iterator[FootContact]:
        """Contacts with the rebound in short drops, and with no worse first long drops, the most
        promising first; each with the model's own cone and with an elliptic one.
        """
        met = []
        for row in self._grid():
            met += self._meeting(row)
        met.sort(key=self._promise)
        for contact in met[:_SETTINGS_MAX]:
            for impratio in _IMPRATIOS:
                varied = replace(contact, impratio=impratio)
                if self._first_drops_are_no_worse(varied):
                    yield varied

    def nearest_contacts(self) -> Iterator[FootContact]:
        """Contacts that are not worse in short drops and the first long ones: of each frequency, and of
        those between, the one whose rebound is nearest to the target; the nearest first.
        """
        rows = self._grid()
        rows += [self._row(math.sqrt(w * v)) for w, v in itertools.pairwise(self._frequencies())]
        nearest = [one for row in rows if (one := self._nearest_of(row)) is not None]
        refined = map(self._still_nearer, sorted(nearest, key=self._miss)[:_NEAREST_MAX])
        yield from sorted(refined, key=self._miss)

    def _nearest_of(self, row: Sequence[FootContact]) -> FootContact | None:
        """The contact to try of one frequency that is nearest to the target and not worse in the drops
        of `nearest_contacts`; None without one.
        """
        for contact in sorted(self._feasible(row), key=self._miss):
            if self._first_drops_are_no_worse(contact):
                return contact
        return None

    def _miss(self, contact: FootContact) -> float:
        """Distance of its rebound from the target in short drops, m."""
        return abs(self._misses(contact))

    def _still_nearer(self, contact: FootContact) -> FootContact:
        """The contact with its damping moved towards the next of the grid, on the side of the
        target, as far as the drops allow: by halving the interval of damping _REFINED times.
        """
        if self._misses(contact) > 0.0:
            beyond = min((one for one in self._dampings if one > contact.damping), default=None)
        else:
            beyond = max((one for one in self._dampings if one < contact.damping), default=None)
        if beyond is None:
            return contact
        for _ in range(_REFINED):
            middle = replace(contact, damping=math.sqrt(contact.damping * beyond))
            if self._is_nearer(middle, contact) and self._first_drops_are_no_worse(middle):
                contact = middle
            else:
                beyond = middle.damping
        return contact

    def _is_nearer(self, one: FootContact, other: FootContact) -> bool:
        """Say whether one contact is nearer to the target in short drops than another, and no worse."""
        if not one.is_kept(self.bench.timestep) or not self._is_no_worse(self._try(one)):
            return False
        return self._miss(one) < self._miss(other)

    def stiffer(self) -> tuple[tuple[float, float], ...]:
        """(factor of kp, largest rebound with it, m) of stiffer servos, until the target is in reach."""
        return tuple(self._with_stiffer_servos())

    def _grid(self) -> list[list[FootContact]]:
        """Contacts to try: a list for each frequency, rising, in each the most damped first.

        The lowest frequency is that of a body which stops within the depth allowed: a spring of
        frequency w stops a speed v within v/w. MuJoCo does not keep a time constant below two
        steps: such contacts are left out.
        """
        return list(map(self._row, self._frequencies()))

    def _frequencies(self) -> list[float]:
        """Frequencies of the contacts to try, rad/s, see `_grid`."""
        h = self.bench.timestep
        deepest = max(1.2 * self.before.depth, self.before.depth + 5e-4)
        speed = math.sqrt(2.0 * self.bench.gravity * REBOUNDS[0].height)
        slowest = min(max(10.0, _SLOWER * speed / deepest), 0.5 * _FASTEST / h)
        frequencies: list[float] = np.geomspace(slowest, _FASTEST / h, _FREQUENCIES).tolist()
        return frequencies

    def _row(self, frequency: float) -> list[FootContact]:
        """Contacts of one frequency to try, see `_grid`."""
        every = [FootContact(frequency, damping) for damping in reversed(self._dampings)]
        return [contact for contact in every if contact.is_kept(self.bench.timestep)]

    def _feasible(self, contacts: Iterable[FootContact]) -> list[FootContact]:
        """Those that are not worse in short drops."""
        return [contact for contact in contacts if self._is_no_worse(self._try(contact))]

    def _is_no_worse(self, test: DropTest) -> bool:
        return not list(test.worse_than(self._untuned, self.target))

    def _try(self, contact: FootContact) -> DropTest:
        """The short drops of a contact."""
        if contact not in self._tried:
            set_contact(self.bench.model, self.plain, self.geoms, contact)
            self._tried[contact] = self.bench.test(self._short, REBOUNDS)
        return self._tried[contact]

    def _meeting(self, row: Sequence[FootContact]) -> list[FootContact]:
        """Contacts of one frequency that have the target's rebound in short drops, and nothing
        worse.

        row: of one frequency, the most damped first. Between two neighbours whose rebounds are
        below and above the target one is looked for.
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

    def _between(self, above: FootContact, below: FootContact) -> FootContact:
        """The contact of one frequency whose rebound is that of the target, to a share of _NEAR, by
        halving the interval of damping.

        above, below: two contacts of the frequency, one with less rebound than the target, one with
        more.
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

    def _is_met(self, contact: FootContact) -> bool:
        """Say whether a contact has the target's rebound in short drops, and is not worse."""
        test = self._try(contact)
        return test.meets(self.target) and self._is_no_worse(test)

    def _misses(self, contact: FootContact) -> float:
        """Rebound beyond the target, m; infinite where it diverges."""
        return self._try(contact).rebound - self.target

    def _promise(self, contact: FootContact) -> float:
        """Less is better: force, depth and chance beside those of the model as it is."""
        test = self._try(contact)
        force = test.peak / max(self._untuned.peak, 1.0)
        depth = test.depth / max(self._untuned.depth, 1e-3)
        chance = test.spread / max(self.target, 1e-3)
        return force + depth + chance

    def _first_drops_are_no_worse(self, contact: FootContact) -> bool:
        set_contact(self.bench.model, self.plain, self.geoms, contact)
        tests = (self.bench.test(self.before.seconds, [drop]) for drop in _FIRST)
        return not any(list(test.worse_than(self.before, self.target)) for test in tests)

    def _with_stiffer_servos(self) -> Iterator[tuple[float, float]]:
        """(factor of kp, largest rebound of contacts that are not worse in short drops, m) of
        stiffer servos, until the target is in reach; nothing without servos, or for a rebound below
        that of the model as it is.

        The model's gains are as they were afterwards.
        """
        model = self.bench.model
        gains = model.actuator_gainprm.copy()
        biases = model.actuator_biasprm.copy()
        servos = biases[:, 1] < 0.0
        is_raised = self.target > self.before.rebound
        for factor in _STIFFER if is_raised and servos.any() else ():
            model.actuator_gainprm[servos, 0] = factor * gains[servos, 0]
            model.actuator_biasprm[servos, 1] = factor * biases[servos, 1]
            model.actuator_biasprm[servos, 2] = math.sqrt(factor) * biases[servos, 2]
            self._tried.clear()
            # A coarse grid tells where the target comes into reach.
            every = itertools.chain.from_iterable(row[::2] for row in self._grid()[::2])
            rebounds = [self._try(contact).rebound for contact in self._feasible(every)]
            largest = max(rebounds, default=0.0)
            yield factor, largest
            if largest >= self.target:
                break
        model.actuator_gainprm[:] = gains
        model.actuator_biasprm[:] = biases
        self._tried.clear()


def advice(model: Any) -> tuple[str, ...]:
    """Sentences on options of a model by which its feet cannot hold, before anything else is tuned."""
    sentences = []
    if model.opt.iterations < _ITERATIONS:
        sentences.append(
            f"The solver stops after {model.opt.iterations} iterations, before the feet's forces "
            'balance: first set <option iterations="100" ls_iterations="50"/>.'
        )
    return tuple(sentences)


def rebound_settings(
    source: Any, requests: Sequence[Request], before: DropTest, target: float
) -> ReboundSettings:
    """Settings of the feet for a rebound, found by drops; the search runs as they are asked for.

    source: a file, MJCF text or an MjSpec. requests: of the feet's pairs. before: the whole test of
    the model as it is. target: the rebound, m.
    Raises UserError for what cannot be dropped or written.
    """
    search = ReboundSearch(source, requests, before, target)

    def settings(contacts: Iterator[FootContact]) -> Iterator[ModelSetting]:
        for contact in contacts:
            yield _setting(source, requests, contact)

    return ReboundSettings(
        settings(search.contacts()),
        settings(search.nearest_contacts()),
        search.stiffer,
        advice(search.plain),
    )


def _setting(source: Any, requests: Sequence[Request], contact: FootContact) -> ModelSetting:
    """A contact of the feet as a setting of a user's model: notes, the model under a request, and
    its text.

    source: a file, MJCF text or an MjSpec. requests: each with the names of a foot and its floor.
    Raises UserError for a source that cannot be written, for unknown pairs and for too many geoms.
    """
    made = write_contact(source, requests, contact)
    notes = [
        *made.notes,
        "friction, condim, margin, masses, step and integrator are as they were; the rebound holds "
        "with them, in this pose with these gains.",
    ]
    label = label_of(source)

    def opened(request: Request) -> ModelUnderTest:
        model, _, state = load(made.spec, request)
        return MujocoModel(model, label, state, request)

    def texts(_: Sequence[Promise], output: Output) -> Texts:
        return texts_of(source, made, (), output)

    return ModelSetting("feet as springs", tuple(notes), opened, texts, source=made.spec)
