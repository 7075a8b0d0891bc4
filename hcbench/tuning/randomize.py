"""Draws contacts for many worlds, whose measured e and friction have an asked distribution in a
user's own model.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.measuring.measure import Job, run_job, source_of
from hcbench.measuring.request import make_request, read_limit
from hcbench.sim.capabilities import (
    LEAST_MOBILITY,
    MOST_NOMINAL,
    ContactFamily,
    RandomizesContacts,
    TunesModels,
)
from hcbench.sim.columns import Whole
from hcbench.sim.model_under_test import BESIDE, ModelUnderTest, Output, Request
from hcbench.sim.passivity import MOST_E
from hcbench.sim.rest import UNKNOWN, WORSE, Standing
from hcbench.sim.simulate import impacts_in
from hcbench.system.errors import LimitPassed, UserError
from hcbench.system.outputs import require_outputs, write_output
from hcbench.system.text import sanitized
from hcbench.terms import units
from hcbench.terms.arguments import checked
from hcbench.terms.options import (
    BodyPair,
    Folders,
    Joints,
    LaunchOptions,
    ModelSource,
    PoseState,
    Quantities,
    Quantity,
)
from hcbench.tuning.answer import MAX_ERROR
from hcbench.tuning.random_worlds import Band, Certificate, RandomWorlds

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from hcbench.terms.impact import Floats, Impact

WORLDS = 4096
MOST_WORLDS = 10_000_000
SPEEDS = "0.5, 1, 2 m/s"
LIMIT_S = 600.0
# Nominal e at which the map is measured, and the phases of a step at each.
_NODES = 13
# Of a first look at how far a family reaches, and by how much that may be wrong. Closer near 0,
# where e changes fastest, and near 1, where one launch of several gains energy.
_FEW_NODES = (0.0, 0.03, 0.11, 0.25, 0.45, 0.7, 0.85, 0.95, MOST_NOMINAL)
_FEW_PHASES = 4
_SLACK = 0.02
# Between the reach that is measured and the one that is named to a user.
_MARGIN = 0.01
# Angles from the normal of launches that slide, rad, at so many phases.
_OBLIQUE = (math.radians(45.0), math.radians(70.0))
_OBLIQUE_PHASES = 4
_PHASES = 8
# Frictions at which it is measured.
_FRICTIONS = 3
# One world in so many is certified; of few worlds more, so that the test has this many.
_SHARE = 10
_LEAST_CERTIFIED = 40
# Slips of oblique launches, over what friction can stop; the first counts that slides throughout.
_SLIPS = (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)
# Why the friction of a pair is not measured.
_HELD = "its joints keep it from sliding"
_STOPS = f"friction stops it before it leaves, even {_SLIPS[-1]:g} times as fast as it needs to"
# Share of its slip that a launch keeps that slides throughout; joints can pull a foot back.
_KEPT_SLIP = 0.25
_SLIDING_PHASES = 2
# A map that falls by more than this has more than one contact of one e.
_FALLS = 0.03
# Differences of e that the map does not tell apart.
_SAME_E = 1e-4


@dataclass(frozen=True, slots=True)
class _RandomizeJob(Job):
    """A job of measuring, with what randomizing needs besides.

    others: requests of further pairs.
    restitution, friction: bands; None: the model's own friction.
    """

    others: tuple[Request, ...] = ()
    restitution: Band = (0.0, 1.0)
    friction: Band | None = None
    worlds: int = WORLDS
    seed: int = 0
    output: Output = BESIDE


@checked
def randomize(
    model: ModelSource,
    pair: BodyPair | Sequence[BodyPair] | None = None,
    *,
    restitution: str | float | tuple[float, float],
    friction: str | float | tuple[float, float] | None = None,
    worlds: int = WORLDS,
    seed: int = 0,
    speeds: Quantities | None = None,
    engine: str | None = None,
    limit: Quantity | None = None,
    timestep: Quantity | None = None,
    gravity: Quantities | None = None,
    key: str | None = None,
    qpos: Joints | None = None,
    state: PoseState | None = None,
    package: Folders | None = None,
    move: str | None = None,
    coming_from: str | Sequence[float | str] | None = None,
    actuators: bool | None = None,
    out: str | Path | None = None,
    write_model: str | Path | None = None,
    force: bool = False,
) -> RandomWorlds:
    """Draw contacts for many worlds, whose measured e and friction are uniform, as
    `hcbench randomize`.

    Parameters
    ----------
    model : path, text or object
        Your model, as `measure` takes it.
    pair : text or two names, or several
        Two bodies or geoms, first the one that moves; or a list of pairs, which share each world's e.
    restitution : text, or two numbers
        Band of e, such as "0.3:0.6" or (0.3, 0.6); one number for all worlds.
    friction : text, or two numbers, optional
        Band of μ; the model's own by default.
    worlds, seed : int
        The number of worlds, and the seed of what is drawn.
    speeds : float, text, quantity of Pint's, or several, optional
        Launch speeds, over which e of a world is the mean; 0.5, 1 and 2 m/s by default.
    engine, limit, timestep, gravity, key, qpos, state, package, move, coming_from, actuators : optional
        As `measure` takes them.
    out, write_model : path, optional
        Files for the parameters (.npz), and for the model to which they belong.
    force : bool
        Replace files that hcbench did not write.

    Returns
    -------
    RandomWorlds
        `parameters` are the engine's own, an array each; the first axis is the world. `failures` says
        what a launch in a tenth of the worlds found wrong; empty where nothing is.

    Raises
    ------
    UserError
        For an e that no contact has in this model, with the range that can be reached, and as `measure`.
    LimitPassed
        For worlds that fail their certificate. Nothing is written then.

    Examples
    --------
    >>> import hcbench as hb
    >>> drawn = hb.randomize("ball.xml", "ball,plate", restitution="0.3:0.6", worlds=40)
    >>> drawn.parameters["pair_solref"].shape
    (40, 1, 2)

    """
    pairs = _each_pair(pair)
    if not pairs:
        advice = f"`hcbench measure {sanitized(model)}` lists them"
        raise UserError("pair", "missing", "two bodies or geoms", advice)
    if not 1 <= worlds <= MOST_WORLDS:
        raise UserError("worlds", str(worlds), f"1 ... {MOST_WORLDS}")
    if seed < 0:
        raise UserError("seed", str(seed), "0 or more")
    launch: LaunchOptions = {
        "speeds": SPEEDS if speeds is None else speeds,
        "timestep": timestep,
        "gravity": gravity,
        "key": key,
        "qpos": qpos,
        "state": state,
        "package": package,
        "move": move,
        "coming_from": coming_from,
        "actuators": actuators,
    }
    first, *others = [make_request(each, **launch) for each in pairs]
    outputs: dict[str, Path] = {}
    if out is not None:
        outputs["--out"] = Path(out)
    if write_model is not None:
        outputs["--write-model"] = Path(write_model)
    require_outputs(outputs, [model, package], force)
    folder = None if write_model is None else Path(write_model).parent
    job = _RandomizeJob(
        source=model,
        engine=engine,
        request=first,
        wanted=None,
        tolerance=0.0,
        diagnose=False,
        others=tuple(others),
        restitution=read_band(restitution, "restitution"),
        friction=None if friction is None else read_band(friction, "friction"),
        worlds=worlds,
        seed=seed,
        output=Output(folder=folder),
    )
    drawn = run_job(_randomized, job, read_limit(limit) or LIMIT_S)
    if drawn.failures:
        advice = "Nothing is written. Ask for a narrower band, or take a smaller --timestep"
        raise LimitPassed(
            "randomize", "; ".join(drawn.failures), "worlds as they were drawn", advice
        )
    if out is not None:
        drawn.save(out, force)
    if write_model is not None:
        write_output(Path(write_model), drawn.texts.written, "--write-model", force)
    return drawn.written_to(tuple(outputs.values()))


def _each_pair(pair: BodyPair | Sequence[BodyPair] | None) -> list[Any]:
    """The pairs of one or of several: "a,b", two names, or a list of either."""
    if pair is None:
        return []
    if isinstance(pair, str) or (len(pair) == 2 and not any("," in str(name) for name in pair)):
        return [pair]
    return list(pair)


def read_band(band: object, quantity: str) -> Band:
    """Lowest and highest value of a band: text such as "0.3:0.6", two numbers, or one for both.

    quantity: name of the slot and of its unit, "restitution" or "friction".
    Raises QuantityError for text that is not a number, UserError for more than two or a first above
    the second.
    """
    ends: Iterable[Any] = [band]
    if isinstance(band, str):
        ends = band.split(":")
    elif isinstance(band, Sequence):
        ends = band
    values = [units.parse(end, quantity, quantity) for end in ends]
    if not 1 <= len(values) <= 2 or values[0] > values[-1]:
        raise UserError(quantity, str(band), "a band, lowest first", "Write for example 0.3:0.6")
    return values[0], values[-1]


def _randomized(job: Job) -> RandomWorlds:
    """Find the first family of contacts that reaches the job's band of e, rests as well as the model
    as it is and throws up nothing that slides; draw the worlds from it, and certify them.

    Raises UserError for an engine without contacts for each world, for a band of friction of a pair
    without friction, and where no family will do: with the widest band that was reached.
    """
    assert isinstance(job, _RandomizeJob)
    requests = (job.request, *job.others)
    engine, source, rebuild = source_of(job)
    if not isinstance(engine, RandomizesContacts):
        expected = "an engine in which each world has contacts of its own"
        raise UserError("engine", repr(engine.name), expected, f"{source!r}")
    before = UNKNOWN
    if isinstance(engine, TunesModels):
        before = engine.standing(source, None, requests)

    def opened(request: Request) -> ModelUnderTest:
        return engine.open(rebuild() if rebuild else source, request)

    rise_as_it_is: float | None = None
    # Of each family that reaches the band and will not do, the reason.
    faults: list[str] = []
    # Families that do not reach the band, with a first look at how far they do.
    short: list[tuple[ContactFamily, list[_Map]]] = []
    for family in engine.contact_families(source, requests, rebuild):
        if job.friction is not None and not family.slides:
            raise UserError("friction", "a band", "a pair with friction", "Its condim is 1")
        rest_faults = _rest_faults(family, requests, job, before)
        if rest_faults:
            faults.append(f"{family.name}: {rest_faults[0]}")
            continue
        # A first look, at the middle friction alone, tells which families are worth their maps.
        frictions = _frictions(job)
        rough = _first_look(family, requests, float(frictions[len(frictions) // 2]))
        maps = rough
        if _covers(_reach(rough), job.restitution, _SLACK):
            nodes = _nodes(rough, job.restitution)
            maps = _measured_maps(family, requests, frictions, nodes, _PHASES)
        if not _covers(_reach(maps), job.restitution):
            short.append((family, rough))
            continue
        # Measured once, and not at all where the band is out of reach.
        if rise_as_it_is is None:
            rise_as_it_is = _rise(opened, requests)
        if _rise_in(family, maps, requests, job) > max(MAX_ERROR, WORSE * rise_as_it_is):
            faults.append(f"{family.name}: sliding throws it up more than the model as it is")
            continue
        models = [family.open(request) for request in requests]
        after = _at_corners(family, maps, models, job)
        worse: list[str] = []
        for stands in after:
            worse += stands.rests_worse_than(before, models[0].timestep)
        if worse:
            faults.append(f"{family.name}: {worse[0]}")
            continue
        return _drawn(family, maps, requests, job, before, after)
    if not short:
        asked = f"{job.restitution[0]:g}:{job.restitution[1]:g}"
        raise UserError("restitution", asked, f"a contact that rests as well ({faults[-1]})")
    raise _out_of_reach(job, requests, short)


def _out_of_reach(
    job: _RandomizeJob,
    requests: Sequence[Request],
    short: Sequence[tuple[ContactFamily, Sequence[_Map]]],
) -> UserError:
    """The error to raise for a band of e that no family of contacts has in this model, with the
    widest that one has; or for a pair whose launches have no e with any of them.

    short: one or more families, with a first look at how far they reach. The widest is measured
    again, since who is refused asks for what the error names.
    """
    family, rough = max(short, key=lambda each: _width(_reach(each[1])))
    frictions = np.unique(_frictions(job)[[0, -1]])
    nodes = _nodes(rough, (0.0, MOST_NOMINAL))
    low, high = _reach(_measured_maps(family, requests, frictions, nodes, _PHASES))
    asked = f"{job.restitution[0]:g}:{job.restitution[1]:g}"
    if not low + _MARGIN < high - _MARGIN:
        # Not a number, where no launch had an e.
        first, second = requests[0].pair or ("the pair", "its floor")
        got = f"launches of {first} on {second} have no e with any contact that was tried"
        raise UserError(
            "pair", got, "launches that bounce", "`hcbench measure` says what stops them"
        )
    # Two digits that lie in it.
    low = math.ceil(100.0 * (low + _MARGIN)) / 100.0
    high = math.floor(100.0 * (high - _MARGIN)) / 100.0
    advice = "A smaller --timestep, other --speeds or another pose reach others"
    return UserError("restitution", asked, f"{low:g} ... {high:g}, the reach in this model", advice)


def _width(band: Band) -> float:
    return band[1] - band[0]


def _rise_in(
    family: ContactFamily, maps: Sequence[_Map], requests: Sequence[Request], job: _RandomizeJob
) -> float:
    """Largest rise of e of a launch that slides over one straight down, at both ends of the job's
    band of e and with its highest μ, or the model's own μ where the job draws none.

    maps: of the pairs, which tell the nominal e at which they have an e of the band. Infinite where
    a launch has no e.
    """
    most = _corners(job)[-1]

    def opened(e: float, request: Request) -> ModelUnderTest:
        model = family.open(request)
        family.set(model, _one_world(family, maps, e, most), 0)
        return model

    return max(_rise(partial(opened, e), requests) for e in job.restitution)


def _one_world(
    family: ContactFamily, maps: Sequence[_Map], e: float, mu: float | None
) -> dict[str, Floats]:
    """Parameters of one world in which every pair has an e, and a μ unless it is the model's own."""
    friction = None if mu is None else np.array([mu])
    return family.parameters(_nominal_of(maps, np.array([e]), friction), friction)


def _rise(opened: Callable[[Request], ModelUnderTest], requests: Sequence[Request]) -> float:
    """Largest e of a launch that slides minus e of one straight down, of one speed along the normal
    and one phase; infinite where a launch has no e, 0 where no pair can slide or e only falls.

    opened: opens the model for a request.
    requests: one a pair; the ends of their bands are used.
    """
    phases = tuple((i + 0.5) / _OBLIQUE_PHASES for i in range(_OBLIQUE_PHASES))
    largest = 0.0
    for request in requests:
        ends = tuple(dict.fromkeys((min(request.speeds), max(request.speeds))))
        sent = dataclasses.replace(request, speeds=ends, phases=phases, angle=(0.0, *_OBLIQUE))
        try:
            with opened(request) as model:
                impacts = impacts_in(model, sent.launches())
        except UserError:
            continue
        # By speed, angle (the first straight down) and phase, in the order of the launches.
        e = np.array([i.restitution for i in impacts]).reshape(len(ends), -1, _OBLIQUE_PHASES)
        rises = np.nan_to_num(e[:, 1:] - e[:, :1], nan=math.inf)
        largest = max(largest, float(rises.max()))
    return largest


def _corners(job: _RandomizeJob) -> list[float | None]:
    """Lowest and highest friction; None alone where it is the model's own."""
    return [None] if job.friction is None else list(dict.fromkeys(job.friction))


def _rest_faults(
    family: ContactFamily, requests: Sequence[Request], job: _RandomizeJob, before: Standing
) -> list[str]:
    """Reasons why a middling contact of a family rests worse than the model as it is, in words, so
    that measuring its map would be in vain; empty where it rests as well.

    requests: one a pair.
    before: the model as it is, at rest.
    """
    models = [family.open(request) for request in requests]
    faults: list[str] = []
    for mu in _corners(job):
        for model in models:
            family.set(model, family.one(0.5, mu), 0)
        faults += family.standing(models).rests_worse_than(before, models[0].timestep)
    return faults


@dataclass(frozen=True, slots=True)
class _Map:
    """From the nominal e of one pair to its measured e, at each of some frictions.

    frictions: μ, (m,); (nan,) for the model's own.
    nominal: (nodes,).
    measured: (m, nodes), rising along the last axis.
    """

    frictions: Floats
    nominal: Floats
    measured: Floats

    @property
    def reach(self) -> Band:
        """Lowest and highest e that the pair has at every friction."""
        return float(self.measured[:, 0].max()), float(self.measured[:, -1].min())

    def nominal_of(self, restitution: Floats, friction: Floats | None) -> Floats:
        """Nominal e by which the pair has an e at a friction, (n,).

        restitution: (n,), within reach.
        friction: (n,); None where one friction was measured.
        """
        at_each = np.array([_inverse(curve, self.nominal, restitution) for curve in self.measured])
        if friction is None or len(self.frictions) == 1:
            return np.asarray(at_each[0])
        place = np.interp(friction, self.frictions, np.arange(len(self.frictions)))
        left = np.minimum(place.astype(int), len(self.frictions) - 2)
        share = place - left
        worlds = np.arange(len(restitution))
        return np.asarray((1 - share) * at_each[left, worlds] + share * at_each[left + 1, worlds])


def _reach(maps: Sequence[_Map]) -> Band:
    """Lowest and highest e that every pair has at every friction, without gain of energy."""
    lows, highs = zip(*(each.reach for each in maps), strict=True)
    return max(lows), min(*highs, MOST_NOMINAL)


def _nominal_of(maps: Sequence[_Map], restitution: Floats, friction: Floats | None) -> Floats:
    """Nominal e by which each pair has an e at a friction, (n, pairs); arguments of
    `_Map.nominal_of`.
    """
    return np.stack([each.nominal_of(restitution, friction) for each in maps], axis=1)


def _inverse(measured: Floats, nominal: Floats, restitution: Floats) -> Floats:
    """Nominal e at which the measured e is this, by lines between the nodes, whose curve hardly
    bends: (n,).

    measured, nominal: e of the nodes, (nodes,), both rising; measured ones may be equal.
    restitution: e asked for, (n,); the end's nominal e is given for one beyond the nodes.
    """
    # Of nodes with one e the last one is kept: below it e does not change.
    differs = np.append(np.diff(measured) > _SAME_E, True)
    return np.asarray(np.interp(restitution, measured[differs], nominal[differs]))


def _frictions(job: _RandomizeJob) -> Floats:
    """Frictions at which e is measured, rising; NaN for the model's own."""
    if job.friction is None:
        return np.array([math.nan])
    return np.unique(np.linspace(*job.friction, _FRICTIONS))


def _covers(reach: Band, band: Band, slack: float = 0.0) -> bool:
    return reach[0] - slack <= band[0] and band[1] <= reach[1] + slack


def _first_look(family: ContactFamily, requests: Sequence[Request], mu: float) -> list[_Map]:
    """A coarse map of each pair at one friction, which is NaN for the model's own: it shows how far
    the family reaches.
    """
    nodes = np.repeat(np.array(_FEW_NODES)[:, None], len(requests), axis=1)
    return _measured_maps(family, requests, np.array([mu]), nodes, _FEW_PHASES)


def _nodes(rough: Sequence[_Map], band: Band) -> Floats:
    """Nominal e of worlds in which all pairs have about one e, evenly spaced over a band and a
    little more, and of the two ends, (nodes, pairs).

    rough: maps of a first look.
    """
    reach = _reach(rough)
    low = max(band[0] - _SLACK, reach[0])
    high = min(band[1] + _SLACK, reach[1])
    inside = _nominal_of(rough, np.linspace(low, high, _NODES), None)
    ends = np.array([[each.nominal[0], each.nominal[-1]] for each in rough]).T
    return np.concatenate([ends[:1], inside, ends[1:]])


def _measured_maps(
    family: ContactFamily,
    requests: Sequence[Request],
    frictions: Floats,
    nodes: Floats,
    phases: int,
) -> list[_Map]:
    """Measure a map of each pair: feet of one robot that weigh the same at the touch can differ in
    e by 0.15, as all four legs bend the same way.

    frictions: μ, (m,).
    nodes: nominal e of all pairs, (nodes, pairs), rising along the first axis: feet that land
    together change each other's e.
    phases: places in a step, of launches at each.
    """
    phase = tuple((i + 0.5) / phases for i in range(phases))
    maps = []
    for request, nominal in zip(requests, nodes.T, strict=True):
        sent = dataclasses.replace(request, phases=phase).launches()
        measured = np.empty((len(frictions), len(nominal)))
        with family.open(request) as model:
            for place, mu in enumerate(frictions.tolist()):
                friction = None if math.isnan(mu) else np.full(len(nominal), mu)
                parameters = family.parameters(nodes, friction)
                for node in range(len(nominal)):
                    family.set(model, parameters, node)
                    impacts = impacts_in(model, sent)
                    e = np.array([i.restitution for i in impacts])
                    # A node at which a launch gains energy has no e to offer.
                    measured[place, node] = e.mean() if e.max() <= MOST_E else math.nan
        maps.append(_map_of(frictions, nominal, measured))
    return maps


def _map_of(frictions: Floats, nominal: Floats, measured: Floats) -> _Map:
    """The map of a pair from what was measured at every node; arguments as of `_Map`.

    Nodes without an e, and those beyond which e falls, are left out: its reach ends there.
    """
    good = _rising(measured)
    return _Map(frictions, nominal[good], np.maximum.accumulate(measured[:, good], axis=-1))


def _rising(measured: Floats) -> slice:
    """The longest run of nodes at which a pair has an e at each friction, and along which none of
    these falls by more than `_FALLS`; as a slice of the last axis.

    measured: (frictions, nodes).
    """
    longest = slice(0, 1)
    start = 0
    count = measured.shape[-1]
    for node in range(count):
        so_far = measured[:, start : node + 1]
        falls = (np.maximum.accumulate(so_far, axis=-1) - so_far).max() > _FALLS
        if falls or not np.isfinite(so_far).all():
            start = node if np.isfinite(measured[:, node]).all() else node + 1
        if node + 1 - start > longest.stop - longest.start:
            longest = slice(start, node + 1)
    return longest


def sliced(worlds: int, dimensions: int, random: np.random.Generator) -> tuple[Floats, Whole]:
    """Draw numbers that are spread evenly, over all worlds and over a tenth of them, too.

    worlds: how many, n.
    dimensions: numbers a world.
    random: draws them.
    Returns the numbers, 0 to 1, (n, dimensions), and the indices of the worlds of the tenth,
    rising. In each dimension every n-th part of 0 to 1 has one number, and each of the tenth's
    larger parts has one number of the tenth (a few may lack where the tenths are not equal).

    P. Z. G. Qian, Sliced Latin hypercube designs, 2012.
    """
    # Of few worlds a tenth is too few to certify: then they are cut into fewer slices.
    slices = max(1, min(_SHARE, worlds // _LEAST_CERTIFIED))
    # Worlds a slice, rounded up.
    size = -(-worlds // slices)
    columns = []
    for _ in range(dimensions):
        # 0 to 1 has `size` large parts, each of them `slices` small ones, which are numbered
        # through. Row i has the small parts of the i-th large one: each slice, a column, gets one.
        levels = np.arange(size * slices).reshape(size, slices)
        levels = random.permuted(levels, axis=1)
        # Each slice has its parts in an order of its own, so that dimensions are independent.
        levels = random.permuted(levels, axis=0)
        columns.append((levels + random.random(levels.shape)) / levels.size)
    # (size, slices, dimensions) to one slice after the other; the last may be cut short. The first
    # is the tenth that is certified.
    by_slice = np.stack(columns, axis=-1).transpose(1, 0, 2)
    shares = by_slice.reshape(-1, dimensions)[:worlds]
    order = random.permutation(worlds)
    return shares[order], np.flatnonzero(order < size)


def _within(band: Band, shares: Floats) -> Floats:
    return np.asarray(band[0] + (band[1] - band[0]) * shares)


def _drawn(
    family: ContactFamily,
    maps: Sequence[_Map],
    requests: Sequence[Request],
    job: _RandomizeJob,
    before: Standing,
    after: tuple[Standing, ...],
) -> RandomWorlds:
    """Draw the worlds of a family, and certify some of them by launches.

    maps, requests: one a pair.
    before: how the model stands as it is.
    after: how it stands in the worlds at the corners of the bands of e and friction.
    """
    random = np.random.default_rng(job.seed)
    shares, certified = sliced(job.worlds, 2, random)
    restitution = _within(job.restitution, shares[:, 0])
    friction = None if job.friction is None else _within(job.friction, shares[:, 1])
    parameters = family.parameters(_nominal_of(maps, restitution, friction), friction)
    models = [family.open(request) for request in requests]
    certificate = _certificate(family, models, requests, job, parameters, certified, random)
    return RandomWorlds(
        parameters=parameters,
        restitution=restitution,
        friction=friction,
        restitution_band=job.restitution,
        friction_band=job.friction,
        seed=job.seed,
        facts=tuple(model.facts() for model in models),
        name=family.name,
        notes=(*family.notes, *_notes(before, certificate, models)),
        certificate=certificate,
        before=before,
        after=after,
        texts=family.texts(job.output),
    )


def _at_corners(
    family: ContactFamily,
    maps: Sequence[_Map],
    models: Sequence[ModelUnderTest],
    job: _RandomizeJob,
) -> tuple[Standing, ...]:
    """Measure how the model stands in the worlds at the corners of both bands.

    maps, models: one a pair.
    """
    after = []
    for e in dict.fromkeys(job.restitution):
        for mu in _corners(job):
            for model in models:
                family.set(model, _one_world(family, maps, e, mu), 0)
            after.append(family.standing(models))
    return tuple(after)


def _notes(
    before: Standing, certificate: Certificate, models: Sequence[ModelUnderTest]
) -> Iterator[str]:
    """Sentences on what the certificate does not compare.

    before: the model as it is, at rest.
    certificate: says which pairs' friction was not measured.
    models: one a pair.
    """
    if before.falls:
        yield (
            "Your model falls over in this pose, so its drift on a slope and its vibration say "
            "nothing and are not compared."
        )
    for model, why in zip(models, certificate.unmeasured, strict=True):
        if why:
            first, second = model.facts().pair
            yield f"{first} on {second}: {why}: its μ is set as drawn, but not measured."


def _certificate(
    family: ContactFamily,
    models: Sequence[ModelUnderTest],
    requests: Sequence[Request],
    job: _RandomizeJob,
    parameters: dict[str, Floats],
    certified: Whole,
    random: np.random.Generator,
) -> Certificate:
    """Launch bodies in some of the worlds at phases that no map used: in each world one pair, the
    pairs in turn. With a band of friction, launch them sliding, too.

    models: opened, one a pair.
    requests: of these.
    parameters: of all worlds, by name.
    certified: indices of the worlds to launch in, (n,).
    random: draws the phases.
    """
    speeds = np.array(job.request.speeds)
    sliding = [_Sliding()] * len(models)
    if job.friction is not None:
        sliding = _sliding_launches(family, models, requests, job)
    unmeasured = [each.fault for each in sliding]
    restitution = np.empty((len(certified), len(speeds)))
    lowest, highest = np.empty((2, len(certified)))
    friction = np.full(len(certified), math.nan)
    energy_gained = -math.inf
    launches = 0
    for row, world in enumerate(certified.tolist()):
        pair = row % len(models)
        model = models[pair]
        family.set(model, parameters, world)
        phases = tuple((np.arange(_PHASES) + random.random()) / _PHASES)
        impacts = impacts_in(model, dataclasses.replace(requests[pair], phases=phases).launches())
        e = np.array([impact.restitution for impact in impacts])
        restitution[row] = e.reshape(len(speeds), _PHASES).mean(axis=1)
        lowest[row] = e.min()
        highest[row] = e.max()
        launches += len(impacts)
        if job.friction is None or unmeasured[pair]:
            continue
        phases = tuple((np.arange(_SLIDING_PHASES) + random.random()) / _SLIDING_PHASES)
        slid = sliding[pair].impacts(model, phases)
        if not slid:
            unmeasured[pair] = _STOPS
            continue
        friction[row] = _friction_of(slid)
        for impact in slid:
            if impact.tangential is not None:
                energy_gained = max(energy_gained, -impact.tangential.energy_lost)
        launches += len(slid)
    # Worlds with much friction stop a launch first: without them those of a pair are not uniform.
    pair_of_row = np.arange(len(certified)) % len(models)
    for pair, why in enumerate(unmeasured):
        if why:
            friction[pair_of_row == pair] = math.nan
    return Certificate(
        worlds=certified,
        speeds=speeds,
        restitution=restitution,
        lowest=lowest,
        highest=highest,
        friction=None if job.friction is None else friction,
        unmeasured=tuple(unmeasured),
        energy_gained=energy_gained,
        launches=launches,
    )


@dataclass(frozen=True, slots=True)
class _Sliding:
    """Oblique launches of a pair that slide throughout, the slowest along the plate first.

    requests: to be tried one after the other; () where the friction is not measured.
    fault: why it is not; "" where it is.
    """

    requests: tuple[Request, ...] = ()
    fault: str = ""

    def impacts(self, model: ModelUnderTest, phases: tuple[float, ...]) -> list[Impact]:
        """Impacts of the first of the launches that slides throughout; [] where friction stops all.

        model: opened for the pair, with the contact of a world.
        phases: of the launches.
        """
        for request in self.requests:
            slid = impacts_in(model, dataclasses.replace(request, phases=phases).launches())
            if _slides_on(slid):
                return slid
        return []


def _sliding_launches(
    family: ContactFamily,
    models: Sequence[ModelUnderTest],
    requests: Sequence[Request],
    job: _RandomizeJob,
) -> list[_Sliding]:
    """Oblique launches of each pair that slide throughout, in worlds with the most friction at both
    ends of the band of e; or why there are none.

    models: opened, one a pair; they are left with other parameters than those of a world.
    requests: of these.
    """
    assert job.friction is not None
    most = job.friction[1]
    sent: list[_Sliding] = []
    for model, request, mobility in zip(models, requests, family.mobility, strict=True):
        if not mobility > LEAST_MOBILITY:
            sent.append(_Sliding(fault=_HELD))
            continue
        # Tangent of the angle at which friction just stops a body, by impulses.
        stops = mobility * (1.0 + job.restitution[1]) * most
        tried = [
            dataclasses.replace(
                request, speeds=(min(request.speeds),), angle=(math.atan(slips * stops),)
            )
            for slips in _SLIPS
        ]
        try:
            while tried and not _slides_at_both_ends(family, model, tried[0], job):
                tried.pop(0)
        # The joints cannot make such a motion.
        except UserError:
            sent.append(_Sliding(fault=_HELD))
            continue
        sent.append(_Sliding(tuple(tried), "" if tried else _STOPS))
    return sent


def _slides_at_both_ends(
    family: ContactFamily, model: ModelUnderTest, request: Request, job: _RandomizeJob
) -> bool:
    """Say whether a launch slides throughout with the most friction and both ends of the band of e.

    model: opened for the pair; left with other parameters.
    Raises UserError where the joints cannot make its motion.
    """
    assert job.friction is not None
    for e in job.restitution:
        family.set(model, family.one(e, job.friction[1]), 0)
        if not _slides_on(impacts_in(model, request.launches())):
            return False
    return True


def _slides_on(impacts: Sequence[Impact]) -> bool:
    """Say whether all impacts end with a good part of the slip with which they began."""
    slips = [(i.tangential.slip_in, i.tangential.slip_out) for i in impacts if i.tangential]
    return bool(slips) and all(
        np.dot(after, before) > _KEPT_SLIP * np.dot(before, before) for before, after in slips
    )


def _friction_of(impacts: Sequence[Impact]) -> float:
    """Mean impulse of friction over that of the normal force; NaN where none was measured."""
    ratios = [i.tangential.impulse_ratio for i in impacts if i.tangential is not None]
    return float(np.mean(ratios)) if ratios else math.nan
