"""MuJoCo: springs of a robot's feet as <pair> elements, tried in drops of the robot and written."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from shlex import quote
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name, explicit_pairs, geom_name
from hcbench.engines.mujoco.model.drop_test import ModelDropBench
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
    new_gravity,
    new_step,
    options_of,
    set_pair,
    spec_of,
    taken_pairs,
    texts_of,
)
from hcbench.sim.landing import DROPS, MANY_REBOUNDS, SECONDS, DropTest, ReboundSettings, kv_factor
from hcbench.sim.model_under_test import ModelSetting, Texts
from hcbench.sim.rebound_search import FootSpring, ReboundSearch, SpringGrid
from hcbench.system.text import joined_names

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from hcbench.sim.landing import RobotDrop
    from hcbench.sim.model_under_test import ModelUnderTest, Output, Request
    from hcbench.sim.promise import Promise

    Geoms = tuple[int, int]

# MuJoCo's own impedance: with it solref alone makes the contact.
SOLIMP = (0.9, 0.95, 0.001, 0.5, 2.0)
# Impedance at the touch of a contact that hardens over its depth, and the share of the depth allowed
# over which it does. Corners of a foot then land more softly one after another, and where in a step
# they touch matters less.
_SOFT_TOUCH = 0.6
_HARDENING = 0.5
# MuJoCo raises a shorter time constant to so many steps.
_LEAST_STEPS = 2.0


@dataclass(frozen=True, slots=True)
class FootContact(FootSpring):
    """A spring with w = 1/(timeconst dampratio) and ζ = dampratio.

    impratio: of the whole model, with elliptic cones; 0 for the model's own cone and impratio.
    hardening: depth over which it hardens from a soft touch, m; 0 for MuJoCo's own impedance.
    """

    impratio: float = 0.0
    hardening: float = 0.0

    @property
    def solref(self) -> tuple[float, float]:
        """MuJoCo's timeconst, s, and dampratio, in the digits that are written."""
        return (
            float(f"{1.0 / (self.frequency * self.damping):.5g}"),
            float(f"{self.damping:.5g}"),
        )

    @property
    def solimp(self) -> tuple[float, ...]:
        """MuJoCo's impedance at the touch and deep inside, the depth between, m, and two of form."""
        if not self.hardening:
            return SOLIMP
        return (_SOFT_TOUCH, SOLIMP[1], float(f"{self.hardening:.3g}"), *SOLIMP[3:])


def foot_geoms(model: Any, requests: Sequence[Request]) -> list[Geoms]:
    """Geoms of the feet and the floor that MuJoCo collides: the numbers of each two.

    requests: each with the names of a foot and its floor.
    Raises UserError for unknown names, and for more geoms than can be written.
    """
    pairs = []
    for request in requests:
        assert request.pair is not None
        pairs.append(named_pair(model, request.pair))
    return colliding_geoms(model, pairs)


def set_contact(model: Any, plain: Any, geoms: Sequence[Geoms], contact: FootContact) -> None:
    """Give the feet a contact in a compiled model: write solref and solimp of their <pair>s, and
    the cone and impratio of the whole model.

    model: changed.
    plain: the model as the user has it, whose cone and impratio hold where the contact has none.
    geoms: numbers of the two geoms of each <pair>.
    """
    for both in geoms:
        for number in explicit_pairs(model, both):
            model.pair_solref[number] = contact.solref
            model.pair_solimp[number] = contact.solimp
    model.opt.cone = plain.opt.cone
    model.opt.impratio = plain.opt.impratio
    if contact.impratio:
        model.opt.cone = int(backend().mjtCone.mjCONE_ELLIPTIC)
        model.opt.impratio = contact.impratio


def write_contact(source: Any, requests: Sequence[Request], contact: FootContact) -> Written:
    """Write a contact of the feet into a copy of a model, as <pair>s that keep the friction, condim
    and margin of the geoms.

    source: a file, MJCF text or an MjSpec; it stays as it is.
    requests: each with the names of a foot and its floor.
    Raises UserError for a source that cannot be written, for unknown pairs and for too many geoms.
    """
    spec = spec_of(source)
    model = spec.compile()
    geoms = foot_geoms(model, requests)
    notes: list[str] = []
    names = name_geoms(spec, model, geoms, notes)
    # The user's own text can stay, with lines added, if its geoms have names (a note says which do
    # not) and it has no <pair>s of them, which the new ones would stand beside.
    own = not notes and not taken_pairs(model, geoms)
    lines = []
    for one, other in geoms:
        both = (names[one], names[other])
        known = [pair for pair in spec.pairs if {pair.geomname1, pair.geomname2} == set(both)]
        values: dict[str, Any] = {"solref": list(contact.solref), "solimp": list(contact.solimp)}
        # A new <pair> takes nothing from its geoms: what was in force is written into it.
        if not known:
            values |= friction_values(model, (one, other))
            if model.geom_margin[[one, other]].any():
                values |= {"margin": _onset(model, one, other), "gap": 0.0}
        elements = known or [spec.add_pair(geomname1=both[0], geomname2=both[1])]
        lines += [set_pair(element, both, values) for element in elements]
    step = new_step(spec, requests[0])
    gravity = new_gravity(spec, requests[0])
    option = options_of(spec, step, gravity)
    if contact.impratio:
        option += elliptic_option(spec, contact.impratio, "feet slip less", notes)
    return Written(spec, contact_text(option, lines), notes, names, own, step, gravity)


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


# Springs that are tried: up to 1/h, beyond which MuJoCo's own step no longer follows them, and
# dampings, which throw a robot up higher than its model does, or less.
_GRID = SpringGrid(
    fastest=1.0,
    frequencies=16,
    dampings=tuple(np.geomspace(0.05, 1.4, 10).tolist()),
    calming=tuple(np.geomspace(0.4, 4.0, 8).tolist()),
    first=(DROPS[-1], DROPS[len(DROPS) // 2]),
    first_seconds=0.6 * SECONDS,
    nearest_frequencies=16,
    nearest=2,
    very_nearest=2,
)
# Slower and coarser springs, between those of the grid: few springs may land no worse, and one grid may
# pass them by.
_SLOW_FASTEST = 0.4
_SLOW_DAMPINGS = tuple(np.geomspace(0.12, 1.4, 8).tolist())
# Work of half a second, in degrees of freedom times steps and their stages, beyond which a model is
# costly: fewer frequencies are tried for it, at least so many.
_WORK = 5500.0
_FEWEST = 8
# Steps by which a contact that was found nearest to the target is moved on, at most, also for a costly
# model, and the smallest, in steps of the grid.
_MOVES = 10
_MOVES_IF_COSTLY = 4
_LEAST_STEP = 0.1
# Impratios with elliptic cones that are tried for less slip; 0 is the model's own.
_IMPRATIOS = (0.0, 10.0)
# Factors of the servos' kp by which more is tried. The first with which the touch alone has the target is
# judged by all drops with so many contacts: they are the first that a `tune` of that model judges.
_STIFFER = (2.0, 4.0, 8.0, 16.0)
_CONTACTS_JUDGED = 3
# Fewer iterations of the solver do not hold a foot.
_ITERATIONS = 20


class PairSearch(ReboundSearch[FootContact]):
    """Contacts of the feet as <pair> elements, tried in drops.

    source: a file, MJCF text or an MjSpec.
    requests: of the feet's pairs.
    before, target: as of `ReboundSearch`. Raises UserError for a robot that cannot be dropped or a
    model that cannot be written.
    """

    grid = _GRID

    def __init__(
        self, source: Any, requests: Sequence[Request], before: DropTest, target: float
    ) -> None:
        """Begin the search: write a first contact into a copy of the model, and make short drops of
        the model as it is to compare with.

        source: a file, MJCF text or an MjSpec.
        requests: of the feet's pairs.
        before: the whole test of the model as it is.
        target: rebound, m; 0 for none.
        """
        self.plain = spec_of(source).compile()
        self.geoms = foot_geoms(self.plain, requests)
        label = label_of(source)
        self._source = source
        self._requests = requests
        # With <pair>s, whose numbers the search sets.
        first = write_contact(source, requests, FootContact(100.0, 1.0))
        self._written = ModelDropBench(first.spec, label, requests)
        self._own = ModelDropBench(spec_of(source), label, requests)
        # Whether a contact lands no worse.
        self._landing: dict[FootContact, bool] = {}
        share = _WORK / max(_WORK, _work(self.plain))
        self._moves = _MOVES
        if share < 1.0:
            self._moves = _MOVES_IF_COSTLY
            frequencies = max(_FEWEST, round(share * _GRID.frequencies))
            self.grid = replace(_GRID, frequencies=frequencies, nearest=1)
        super().__init__(self._written, before, target)

    @property
    def standing(self) -> set[Geoms]:
        """(robot's geom, floor's) on which the robot stands, as it is."""
        return self._own.standing_geoms()

    def spring(self, frequency: float, damping: float) -> FootContact:
        """The contact with the model's own cone and impratio."""
        return FootContact(frequency, damping)

    def drop(
        self, spring: FootContact | None, seconds: float, drops: Sequence[RobotDrop]
    ) -> DropTest:
        """Drop the robot with a contact of its feet, and judge the landing.

        spring: the contact, written into the <pair>s; None for the model as it is.
        seconds: to simulate of each drop.
        drops: heights, tilts and phases.
        """
        if spring is None:
            return self._own.test(seconds, drops)
        set_contact(self._written.model, self.plain, self.geoms, spring)
        return self._written.test(seconds, drops)

    def is_kept(self, spring: FootContact) -> bool:
        """Say whether MuJoCo keeps the time constant, which it raises to two steps."""
        return spring.solref[0] >= _LEAST_STEPS * self.bench.timestep

    def kinds(self, spring: FootContact) -> tuple[FootContact, ...]:
        """The contact with MuJoCo's own impedance, and one that hardens over its depth."""
        return spring, replace(spring, hardening=_HARDENING * self.deepest)

    def stop(self, damping: float) -> float:
        """Way in which a damped spring stops a body, over that without damping: the largest value of
        the solution x(t) of x'' + 2 ζ w x' + w² x = 0 for x(0) = 0, x'(0) = w.
        """
        if damping == 1.0:
            return math.exp(-1.0)
        root = math.sqrt(abs(1.0 - damping**2))
        turn = math.acos(damping) if damping < 1.0 else math.acosh(damping)
        return math.exp(-damping / root * turn)

    def variants(self, spring: FootContact) -> Iterable[FootContact]:
        """The contact with the model's own cone, and with an elliptic one."""
        return [replace(spring, impratio=impratio) for impratio in _IMPRATIOS]

    def nearest_contacts(self) -> Iterator[FootContact]:
        """Yield contacts that are not worse in short drops and in long ones, and whose rebound is
        nearer to the target than the model's: the nearest of the grid, moved on in frequency and
        damping, the nearest at many places in a step first, and then the others of the grid.
        """
        grid = itertools.chain.from_iterable(self._rows())
        feasible = self._feasible(itertools.chain(grid, self._slow()))
        own = abs(self._untuned.rebound - self.target)
        nearer = sorted((one for one in feasible if self._miss(one) < own), key=self._miss)
        varied = itertools.chain.from_iterable(map(self.variants, nearer))
        landing = filter(self._lands_no_worse, varied)
        ways = map(self._moved, itertools.islice(landing, self.grid.nearest))
        moved = dict.fromkeys(itertools.chain.from_iterable(ways))
        yield from sorted(moved, key=self._miss_of_many)
        yield from landing

    def _slow(self) -> list[FootContact]:
        """Contacts to try beside the rows of the grid: softer springs with MuJoCo's own impedance, at
        other frequencies and dampings.
        """
        fastest = _SLOW_FASTEST / self.bench.timestep
        slowest = min(self._slowest(0.0), 0.5 * fastest)
        frequencies: list[float] = np.geomspace(slowest, fastest, self.grid.frequencies).tolist()
        is_raised = self._dampings == self.grid.dampings
        dampings = _SLOW_DAMPINGS if is_raised else self._dampings
        springs = itertools.starmap(self.spring, itertools.product(frequencies, dampings))
        return list(filter(self.is_kept, springs))

    def _miss_of_many(self, contact: FootContact) -> float:
        """Distance from the target, m, of the mean rebound at as many places in a step as a whole test
        has: that of the few of a search is chance where the robot leaves the floor at some alone.
        """
        return abs(self.drop(contact, self._short, MANY_REBOUNDS).rebound - self.target)

    def _moved(self, contact: FootContact) -> list[FootContact]:
        """The contact, and those over which it is moved in frequency and damping as far as it comes
        nearer to the target and does not land worse: by compass search (Kolda, Lewis and Torczon
        2003, SIAM Review 45, 385).

        Steps begin at half the ratio of neighbours in the grid, and are halved where none helps. The
        edge of what lands no worse is oblique: both may change at once.
        """
        way = [contact]
        size = 0.5
        for _ in range(self._moves):
            nearer = self._step_nearer(way[-1], size)
            if nearer is not None:
                way.append(nearer)
                continue
            size *= 0.5
            if size < _LEAST_STEP:
                break
        return way

    def _step_nearer(self, contact: FootContact, size: float) -> FootContact | None:
        """The neighbour of a contact that is nearest to the target, of those that land no worse; None
        where none is nearer than the contact.

        size: of the step, in steps of the grid.
        """
        frequencies = self._frequencies(self.grid.frequencies)
        faster = (frequencies[1] / frequencies[0]) ** size
        damped = (self._dampings[1] / self._dampings[0]) ** size
        neighbours = []
        for along, across in itertools.product((-1, 0, 1), repeat=2):
            frequency = contact.frequency * faster**along
            damping = contact.damping * damped**across
            moved = replace(contact, frequency=frequency, damping=damping)
            if self.is_kept(moved) and self._is_no_worse(self._try(moved)):
                neighbours.append(moved)
        for moved in sorted(neighbours, key=self._miss):
            if self._miss(moved) >= self._miss(contact):
                break
            if self._lands_no_worse(moved):
                return moved
        return None

    def _lands_no_worse(self, contact: FootContact) -> bool:
        """Say whether no first drop of a contact is worse than that of the model, and none of every
        second one of its whole test; of these the highest come first, in which most fail.
        """
        if contact not in self._landing:
            self._landing[contact] = self._first_drops_are_no_worse(contact) and all(
                self._is_no_worse_than_all(drop, contact) for drop in self.bench.drops[-2::-2]
            )
        return self._landing[contact]

    def _is_no_worse_than_all(self, drop: RobotDrop, contact: FootContact) -> bool:
        """Say whether nothing is worse in one drop of a contact than in all of the model as it is."""
        dropped = self.drop(contact, self.before.seconds, [drop])
        return not list(dropped.worse_than(self.before, self.target))

    def stiffer(self) -> tuple[tuple[float, float], ...]:
        """(factor of kp, rebound, m) of stiffer servos that were tried, up to the first with the target at
        the touch; NaN where no contact has it there, or none that lands no worse.
        """
        return tuple(self._with_stiffer_servos())

    def _with_stiffer_servos(self) -> Iterator[tuple[float, float]]:
        """Yield them; nothing for a model without servos of its own, and for a target below the rebound
        of the model as it is.
        """
        is_raised = self.target > self.before.rebound
        has_servos = bool((self.plain.actuator_biasprm[:, 1] < 0.0).any())
        for factor in _STIFFER if is_raised and has_servos else ():
            # The touch alone takes little time, and tells where the target comes into reach.
            if self._largest_at_touch(factor) >= self.target:
                yield factor, self._judged_with(factor)
                break
            yield factor, math.nan

    def _largest_at_touch(self, factor: float) -> float:
        """Largest rebound, m, in short drops of a coarse grid of contacts that are not worse in them,
        with the servos' gains raised.

        factor: of kp. The model's gains are changed meanwhile, and as they were afterwards.
        """
        model = self._written.model
        gains = model.actuator_gainprm.copy()
        biases = model.actuator_biasprm.copy()
        servos = biases[:, 1] < 0.0
        model.actuator_gainprm[servos, 0] = factor * gains[servos, 0]
        model.actuator_biasprm[servos, 1] = factor * biases[servos, 1]
        model.actuator_biasprm[servos, 2] = kv_factor(factor) * biases[servos, 2]
        largest = self.largest_of_few()
        model.actuator_gainprm[:] = gains
        model.actuator_biasprm[:] = biases
        return largest

    def _judged_with(self, factor: float) -> float:
        """Rebound, m, with stiffer servos and the first contact that has the target there and with which
        nothing is worse, by all drops, than in that model as it is; NaN where none has.

        factor: of kp. A `tune` of that model makes the same drops first: it finds this contact.
        """
        spec = stiffened(self._source, factor)
        before = ModelDropBench(spec, label_of(self._source), self._requests).whole_test(None)
        if before.diverged:
            return math.nan
        if before.meets(self.target):
            return before.rebound
        search = PairSearch(spec, self._requests, before, self.target)
        for contact in itertools.islice(search.contacts(), _CONTACTS_JUDGED):
            test = search.whole_test(contact)
            if test.meets(self.target) and not list(test.worse_than(before, self.target)):
                return test.rebound
        return math.nan

    def whole_test(self, contact: FootContact) -> DropTest:
        """Drop the robot with a contact of its feet by all drops, as long as the model as it is."""
        set_contact(self._written.model, self.plain, self.geoms, contact)
        return self._written.whole_test(self.before)


def _work(model: Any) -> float:
    """Work of half a second of a compiled model: its degrees of freedom, times the steps, times the
    stages of each.
    """
    is_rk4 = model.opt.integrator == backend().mjtIntegrator.mjINT_RK4
    stages = 4 if is_rk4 else 1
    return float(stages * model.nv * 0.5 / model.opt.timestep)


def stiffened(source: Any, factor: float) -> Any:
    """A copy of a model whose position servos have `factor` times the kp and `kv_factor` times the kv,
    as an MjSpec.

    source: a file, MJCF text or an MjSpec; it stays as it is.
    """
    spec = spec_of(source)
    for actuator in spec.actuators:
        # MuJoCo: force = gain ctrl + b0 + b1 length + b2 velocity, b1 = -kp and b2 = -kv of a servo; a b2
        # above 0 is a ratio of damping, from which the compiler takes kv.
        if not actuator.biasprm[1] < 0.0:
            continue
        actuator.gainprm[0] *= factor
        actuator.biasprm[1] *= factor
        if actuator.biasprm[2] < 0.0:
            actuator.biasprm[2] *= kv_factor(factor)
    return spec


def advice(model: Any) -> tuple[str, ...]:
    """Sentences on options of a model by which its feet cannot hold, before anything else is tuned; so
    far one, on a solver that stops too soon.

    model: compiled, as the user has it.
    """
    sentences = []
    if model.opt.iterations < _ITERATIONS:
        count = int(model.opt.iterations)
        sentences.append(
            f"The solver stops after {count} iteration{'s' if count > 1 else ''}, before the feet's forces "
            'balance: first set <option iterations="100" ls_iterations="50"/>.'
        )
    return tuple(sentences)


def _all_feet(search: PairSearch, requests: Sequence[Request]) -> tuple[str, ...]:
    """Advice to name all feet: one sentence, if parts that no pair names stand on the floor, with
    the options that name all; else empty.

    A spring of one foot of four hardly changes how the robot lands, at any step.
    """
    if search.before.falls:
        return ()
    model = search.plain
    # Rigid bodies of the geoms that the pairs name.
    named: set[int] = set()
    for both in search.geoms:
        for geom in both:
            named.add(int(model.body_weldid[model.geom_bodyid[geom]]))
    # Names of parts and their floor, by body.
    others: dict[int, list[tuple[str, str]]] = {}
    for geom, floor in sorted(search.standing):
        body = int(model.body_weldid[model.geom_bodyid[geom]])
        if body not in named:
            others.setdefault(body, []).append((_part(model, geom), _part(model, floor)))
    if not others:
        return ()
    # A body without a named geom has its own name several times.
    left_out = [pair for pairs in others.values() for pair in dict.fromkeys(pairs)]
    pairs = [request.pair for request in requests if request.pair] + left_out
    options = " ".join(f"--pair {quote(joined_names(pair))}" for pair in pairs)
    parts = ", ".join(part for part, _ in left_out)
    return (f"Other parts stand on the floor, too: {parts}. Name them all: {options}.",)


def _part(model: Any, geom: int) -> str:
    """Name of a geom, or of its body where it has none."""
    if model.geom(geom).name:
        return geom_name(model, geom)
    body = int(model.geom_bodyid[geom])
    return body_name(model, body) if body else geom_name(model, geom)


def rebound_settings(
    source: Any, requests: Sequence[Request], before: DropTest, target: float
) -> ReboundSettings:
    """Settings of a robot's feet with which its centre of mass rebounds to the target, found by
    drops of the robot; each search runs as its settings are asked for.

    source: a file, MJCF text or an MjSpec.
    requests: of the feet's pairs.
    before: the whole test of the model as it is.
    target: the rebound, m.
    Raises UserError for what cannot be dropped or written.
    """
    search = PairSearch(source, requests, before, target)

    def settings(contacts: Iterator[FootContact]) -> Iterator[ModelSetting]:
        """Yield each contact that a search finds, written into the model."""
        for contact in contacts:
            yield _setting(source, requests, contact)

    return ReboundSettings(
        settings(search.contacts()),
        settings(search.nearest_contacts()),
        settings(search.trading_contacts()),
        search.stiffer,
        (*_all_feet(search, requests), *advice(search.plain)),
    )


def _setting(source: Any, requests: Sequence[Request], contact: FootContact) -> ModelSetting:
    """A contact of the feet as a setting of a user's model: notes, the model under a request, and
    its text.

    source: a file, MJCF text or an MjSpec.
    requests: each with the names of a foot and its floor.
    Raises UserError for a source that cannot be written, for unknown pairs and for too many geoms.
    """
    made = write_contact(source, requests, contact)
    notes = [
        *made.notes,
        f"{made.kept}; the rebound holds with them, in this pose with these gains.",
    ]
    label = label_of(source)

    def opened(request: Request) -> ModelUnderTest:
        """The model with the springs under a request."""
        model, _, state = load(made.spec, request)
        return MujocoModel(model, label, state, request)

    def texts(_: Sequence[Promise], output: Output) -> Texts:
        """Lines and models with the springs; no promise, as the rebound is that of a pose and gains."""
        return texts_of(source, made, (), output)

    return ModelSetting("feet as springs", tuple(notes), opened, texts, source=made.spec)
