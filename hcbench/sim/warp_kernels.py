"""Kernels of Warp that let contacts of many worlds collide; `hcbench.sim.warp_contact` starts them.

Warp reads the source text of this file: only code that has Warp may import it. Contacts of all
worlds lie together, in the order in which threads found them; a list for each world links its own.
"""

import warp as wp

from hcbench.sim.pair_laws import (
    BEARS,
    CONSTANT,
    LEAST_NUMBER,
    LINEAR,
    MOST_NUMBER,
    NUMBERS,
    RISE,
    STILL,
    SWEEPS,
)

wp.set_module_options({"enable_backward": False})

# Friction and impedance have five numbers.
_Five = wp.types.vector(length=5, dtype=float)
# Marks a contact that a solver's rows are made of, in MJCF models on a device.
_CONSTRAINT = wp.constant(1)
_STILL = wp.constant(STILL)
_SWEEPS = wp.constant(SWEEPS)
_RISE = wp.constant(RISE)
_BEARS = wp.constant(BEARS)
_LINEAR = wp.constant(LINEAR)
_CONSTANT = wp.constant(CONSTANT)
_LEAST_NUMBER = wp.constant(LEAST_NUMBER)
_POINTS = wp.constant(NUMBERS.size - 1)
_POINTS_PER_E_FOLD = wp.constant(
    float((NUMBERS.size - 2) / (wp.log(MOST_NUMBER) - wp.log(LEAST_NUMBER)))
)
# Change of a rate below which sweeps have settled: as a share of the fastest approach, and of the
# fastest rate, below which float32 has noise alone.
_SETTLED = wp.constant(1e-5)
_NOISE = wp.constant(4e-7)


@wp.struct
class Found:
    """Contacts of all worlds, as the engine found them in this step, or had them in the last;
    arrays of one entry a contact, in the world's frame, SI.

    count: number of contacts, (1,); entries beyond it are old.
    world: number of its world.
    geom: numbers of its two geoms.
    place: number among those that two geoms can have, such as that of a box's corner.
    mark: bits, of which _CONSTRAINT marks a contact that the solver makes rows of.
    dim: rows of it, 1 without friction.
    dist: of the two geoms, m, below 0 where they overlap.
    margin: distance at which it begins to act, m.
    pos: where it is, m.
    frame: its axes as rows, the normal first, from the first geom to the second.
    solref: of its spring.
    row: addresses of its constraint rows, the normal's first; -1 without.
    """

    count: wp.array[int]
    world: wp.array[int]
    geom: wp.array[wp.vec2i]
    place: wp.array[int]
    mark: wp.array[int]
    dim: wp.array[int]
    dist: wp.array[float]
    margin: wp.array[float]
    pos: wp.array[wp.vec3]
    frame: wp.array[wp.mat33]
    solref: wp.array[wp.vec2]
    row: wp.array2d[int]


@wp.struct
class Room:
    """Memory of one step: numbers of each contact, and the first contact of each world's list.

    Arrays have one entry a contact unless a shape is given. Rates are along a contact's normal,
    above 0 where it parts, and its two tangents.
    first, first_before: number of the first contact with a law, now and in the step before,
    (worlds,); -1 of none.
    following, following_before: number of the next contact in those lists; -1 at the end.
    geom_before, place_before, force_before: geoms, place and normal force, N, of contacts of the
    step before.
    law: number of the pair; -1 of none.
    dist, solref: as found, since `settle` changes those of the engine.
    rows: rates over velocities, (contacts, nv): the Jacobian.
    moves: M⁻¹ of the rows, (contacts, nv).
    own: rates that impulses of the same contact make, 1/kg.
    rate: before impulses, less half a step's push, m/s.
    impulse: N s.
    target: least rate at which it parts, m/s.
    calm: speed that counts as rest, m/s.
    load: acceleration that presses the two together, m/s².
    factor: L and D of M = Lᵀ D L, (worlds, nC).
    change: of the velocities, by all impulses, (worlds, nv).
    """

    first: wp.array[int]
    first_before: wp.array[int]
    following: wp.array[int]
    following_before: wp.array[int]
    geom_before: wp.array[wp.vec2i]
    place_before: wp.array[int]
    force_before: wp.array[float]
    law: wp.array[int]
    dist: wp.array[float]
    solref: wp.array[wp.vec2]
    rows: wp.array2d[wp.vec3]
    moves: wp.array2d[wp.vec3]
    own: wp.array[wp.mat33]
    rate: wp.array[wp.vec3]
    impulse: wp.array[wp.vec3]
    target: wp.array[float]
    calm: wp.array[float]
    load: wp.array[float]
    factor: wp.array2d[float]
    change: wp.array2d[float]


@wp.struct
class LawsThere:
    """Laws of pairs, in arrays on a device; see `Laws` of `pair_laws`, which is on the host.

    pair_of: number of the pair of two geoms, (ngeom, ngeom); -1 of none.
    reading: what the value of each pair is, _LINEAR, _CONSTANT or neither, (pairs,).
    e: of the law, at the points of its table over α v.
    """

    pair_of: wp.array2d[int]
    reading: wp.array[int]
    e: wp.array[float]


@wp.struct
class Inertia:
    """The rows of the inertia matrix: entries of each, address of the first, and their columns."""

    count: wp.array[int]
    start: wp.array[int]
    column: wp.array[int]


@wp.func
def _law(laws: LawsThere, geom: wp.vec2i) -> int:
    # Those of flexible bodies are -1.
    if geom[0] < 0 or geom[1] < 0:
        return -1
    return laws.pair_of[geom[0], geom[1]]


@wp.kernel
def remember(
    found: Found,
    laws: LawsThere,
    is_pyramidal: bool,
    rows: wp.array[int],
    force: wp.array2d[float],
    room: Room,
) -> None:
    """Keep the places and normal forces, N, of the last step's contacts, linked by world. A thread
    for each contact.

    found: the contacts.
    laws: of the pairs.
    room: written to.
    is_pyramidal: whether the friction cone is a pyramid.
    rows: number of each world's constraint rows, (worlds,).
    force: of each of these rows, N, (worlds, rows).
    """
    i = wp.tid()
    if i >= found.count[0]:
        return
    geom = found.geom[i]
    if (found.mark[i] & _CONSTRAINT) == 0 or _law(laws, geom) < 0:
        return
    row = found.row[i, 0]
    world = found.world[i]
    # The edges of a pyramid share the normal's force.
    edges = int(1)
    if is_pyramidal and found.dim[i] > 1:
        edges = 2 * (found.dim[i] - 1)
    if row < 0 or row + edges > wp.min(rows[world], force.shape[1]):
        return
    total = float(0.0)
    for edge in range(edges):
        total += force[world, row + edge]
    room.geom_before[i] = geom
    room.place_before[i] = found.place[i]
    room.force_before[i] = total
    room.following_before[i] = wp.atomic_exch(room.first_before, world, i)


@wp.kernel
def enlist(found: Found, laws: LawsThere, room: Room) -> None:
    """Put the contacts that touch and have a law into the lists of their worlds.

    found: the contacts.
    laws: of the pairs.
    room: written to.
    """
    i = wp.tid()
    if i >= found.count[0]:
        return
    room.law[i] = -1
    if (found.mark[i] & _CONSTRAINT) == 0 or found.dist[i] >= found.margin[i]:
        return
    room.law[i] = _law(laws, found.geom[i])
    if room.law[i] < 0:
        return
    room.dist[i] = found.dist[i]
    room.solref[i] = found.solref[i]
    room.following[i] = wp.atomic_exch(room.first, found.world[i], i)


@wp.func
def _sort(room: Room, world: int) -> int:
    """Sort a world's list of contacts by number, in place, and return the first of it; -1 if it is
    empty.

    Threads fill a list in any order; sums are the same bits in the engine's order alone. By
    insertion: lists are short.
    """
    first = int(-1)
    i = room.first[world]
    while i >= 0:
        following = room.following[i]
        if first < 0 or i < first:
            room.following[i] = first
            first = i
        else:
            before = first
            while room.following[before] >= 0 and room.following[before] < i:
                before = room.following[before]
            room.following[i] = room.following[before]
            room.following[before] = i
        i = following
    return first


@wp.kernel
def factor(inertia: Inertia, M: wp.array2d[float], room: Room) -> None:
    """Put the contacts of each world into the engine's order, and factor its inertia matrix where
    it has any: M = Lᵀ D L.

    A thread for each world.
    M: entries of each world's inertia matrix, row after row, (worlds, nC).
    A row's columns are the ancestors of its degree of freedom, its diagonal last, as in
    Featherstone 2008, table 6.3.
    inertia: where the rows of the matrix are.
    room: its `first` and `following` are sorted, `factor` is written.
    """
    world = wp.tid()
    if room.first[world] < 0:
        return
    room.first[world] = _sort(room, world)
    for j in range(M.shape[1]):
        room.factor[world, j] = M[world, j]
    size = inertia.count.shape[0]
    for back in range(size):
        k = size - 1 - back
        start = inertia.start[k]
        others = inertia.count[k] - 1
        diagonal = room.factor[world, start + others]
        for step in range(others):
            place = start + others - 1 - step
            i = inertia.column[place]
            share = room.factor[world, place] / diagonal
            for j in range(inertia.count[i]):
                room.factor[world, inertia.start[i] + j] -= share * room.factor[world, start + j]
            room.factor[world, place] = share


@wp.func
def _solve(inertia: Inertia, world: int, contact: int, room: Room) -> None:
    """Replace a contact's `moves`, b, by M⁻¹ b, in place, with M = Lᵀ D L as `factor` left it: first
    Lᵀ from the last row to the first, then D and L from the first to the last.
    """
    size = inertia.count.shape[0]
    for back in range(size):
        k = size - 1 - back
        start = inertia.start[k]
        value = room.moves[contact, k]
        for j in range(inertia.count[k] - 1):
            i = inertia.column[start + j]
            room.moves[contact, i] -= room.factor[world, start + j] * value
    for k in range(size):
        start = inertia.start[k]
        others = inertia.count[k] - 1
        value = room.moves[contact, k] / room.factor[world, start + others]
        for j in range(others):
            value -= room.factor[world, start + j] * room.moves[contact, inertia.column[start + j]]
        room.moves[contact, k] = value


@wp.func
def _velocity(motion: wp.spatial_vector, arm: wp.vec3) -> wp.vec3:
    """Velocity at the end of an arm, m/s, of a motion about its start: angular, then linear."""
    return wp.spatial_bottom(motion) + wp.cross(wp.spatial_top(motion), arm)


@wp.func
def _force_before(found: Found, room: Room, contact: int) -> float:
    """Normal force that a contact had in the step before, N; 0 of a new one."""
    i = room.first_before[found.world[contact]]
    while i >= 0:
        is_same_place = room.place_before[i] == found.place[contact]
        if is_same_place and room.geom_before[i] == found.geom[contact]:
            return room.force_before[i]
        i = room.following_before[i]
    return 0.0


@wp.func
def _restitution(laws: LawsThere, reading: int, value: float, speed: float) -> float:
    """Coefficient of restitution, 0 to 1, of a pair at an impact speed, m/s.

    laws: has the table of the law's e.
    reading: what `value` is: _CONSTANT for e itself, _LINEAR for α (s/m) of e = 1 - α v, else α of
    the law, whose e is read from a table over α v, in even steps of its logarithm.
    """
    if reading == _CONSTANT:
        return wp.clamp(value, 0.0, 1.0)
    number = value * speed
    if reading == _LINEAR:
        return wp.clamp(1.0 - number, 0.0, 1.0)
    if number <= _LEAST_NUMBER:
        return 1.0
    # Point 0 of the table is α v = 0; the even steps begin with point 1.
    place = wp.log(number / _LEAST_NUMBER) * _POINTS_PER_E_FOLD
    point = wp.min(int(place), _POINTS - 2)
    share = wp.min(place - float(point), 1.0)
    return (1.0 - share) * laws.e[point + 1] + share * laws.e[point + 2]


@wp.func
def _parting(
    laws: LawsThere,
    reading: int,
    value: float,
    approach: float,
    depth: float,
    presses: float,
    timestep: float,
) -> float:
    """Rate, m/s, at which a contact parts, so that e is that of the speed at the touch plane.

    Steps that move by the new velocity keep U² = (v + b h/2)² - 2 b x in flight, U the speed at the
    plane x = 0, b = `presses`. A contact that touched before this step has the e of v.

    reading, value: the pair's law, as in `_restitution`.
    approach: v, m/s.
    depth: x, m.
    presses: acceleration that presses the two together, m/s².
    timestep: h, s.
    """
    half = presses * timestep / 2.0
    speed = approach + half
    # No deeper than one step's way: it touched within the last step. The margin is for float32.
    if depth <= timestep * approach * (1.0 + 1e-5):
        lift = 2.0 * presses * depth
        at_plane = wp.sqrt(wp.max(speed * speed - lift, 0.0))
        out = _restitution(laws, reading, value, at_plane) * at_plane
        return wp.sqrt(out * out + lift)
    return _restitution(laws, reading, value, approach) * approach - half


@wp.func
def _weight(
    normal: wp.vec3, gravity: wp.vec3, body1: int, body2: int, body_weldid: wp.array[int]
) -> float:
    """Acceleration, m/s², by which gravity alone presses one of two bodies against the other: the
    larger of both, 0 or more.

    body1, body2: numbers of the two bodies.
    normal: from the first body to the second, unit vector.
    gravity: m/s².
    body_weldid: 0 for bodies that are fixed to the world, whose weight presses nothing.
    """
    along = wp.dot(normal, gravity)
    weight = float(0.0)
    if body_weldid[body1] != 0:
        weight = wp.max(weight, along)
    if body_weldid[body2] != 0:
        weight = wp.max(weight, -along)
    return weight


@wp.kernel
def span(
    found: Found,
    geom_bodyid: wp.array[int],
    body_rootid: wp.array[int],
    body_isdofancestor: wp.array2d[int],
    subtree_com: wp.array2d[wp.vec3],
    cdof: wp.array2d[wp.spatial_vector],
    room: Room,
) -> None:
    """Find the rates along the axes of each contact's frame that each velocity makes: its Jacobian,
    into `room.rows` and, to be divided by the inertia, into `room.moves`.

    A thread for each contact and velocity.
    geom_bodyid, body_rootid: body of each geom, and root of each body's tree.
    body_isdofancestor: whether a velocity moves a body, (bodies, nv).
    subtree_com: m, (worlds, bodies).
    cdof: motion of each velocity about the centre of mass of its tree, angular then linear,
    (worlds, nv).
    found: the contacts.
    room: written to.
    """
    i, v = wp.tid()
    if i >= found.count[0]:
        return
    if room.law[i] < 0:
        return
    world = found.world[i]
    body1 = geom_bodyid[found.geom[i][0]]
    body2 = geom_bodyid[found.geom[i][1]]
    motion = cdof[world, v]
    row = wp.vec3(0.0)
    if body_isdofancestor[body1, v] != 0:
        arm = found.pos[i] - subtree_com[world, body_rootid[body1]]
        row -= found.frame[i] * _velocity(motion, arm)
    if body_isdofancestor[body2, v] != 0:
        arm = found.pos[i] - subtree_com[world, body_rootid[body2]]
        row += found.frame[i] * _velocity(motion, arm)
    room.rows[i, v] = row
    room.moves[i, v] = row


@wp.kernel
def aim(
    found: Found,
    laws: LawsThere,
    values: wp.array2d[float],
    inertia: Inertia,
    timesteps: wp.array[float],
    gravities: wp.array[wp.vec3],
    geom_bodyid: wp.array[int],
    body_weldid: wp.array[int],
    qvel: wp.array2d[float],
    qacc: wp.array2d[float],
    qfrc_smooth: wp.array2d[float],
    room: Room,
) -> None:
    """Find how each contact moves, what loads it, and the rate at which it shall part: its `rate`,
    `own`, `target`, `calm` and `load` in `room`. A thread for each contact.

    found, laws, inertia: of the engine's contacts, the pairs and the matrix of inertia.
    values: α (s/m) or e of each pair, (worlds or 1, pairs). timesteps, s, and gravities, m/s²: of
    each world, or one for all.
    qvel: velocities, (worlds, nv).
    qacc, qfrc_smooth: accelerations and forces of all but constraints, of the step before.
    """
    i = wp.tid()
    if i >= found.count[0]:
        return
    law = room.law[i]
    if law < 0:
        return
    world = found.world[i]
    timestep = timesteps[world % timesteps.shape[0]]
    size = inertia.count.shape[0]
    _solve(inertia, world, i, room)
    # Rates along the contact's axes, m/s; rates that its own impulses make, 1/kg; accelerations of
    # the normal, m/s², by smooth forces alone (together above 0) and in all (apart above 0).
    rate = wp.vec3(0.0)
    own = wp.mat33(0.0)
    pushed = float(0.0)
    moved = float(0.0)
    for v in range(size):
        row = room.rows[i, v]
        rate += row * qvel[world, v]
        own += wp.outer(row, room.moves[i, v])
        pushed -= room.moves[i, v][0] * qfrc_smooth[world, v]
        moved += row[0] * qacc[world, v]
    # Of gravity, motors and springs, as the step before had them.
    presses = wp.max(pushed, 0.0)
    # All other forces of the step before: a foot may be pressed through a joint's limit, a body by
    # others that lie on it.
    others = own[0, 0] * _force_before(found, room, i) - moved
    gravity = gravities[world % gravities.shape[0]]
    normal = wp.transpose(found.frame[i]) * wp.vec3(1.0, 0.0, 0.0)
    body1 = geom_bodyid[found.geom[i][0]]
    body2 = geom_bodyid[found.geom[i][1]]
    weight = _weight(normal, gravity, body1, body2, body_weldid)
    load = wp.max(wp.max(presses, weight), others)
    # Without a load only what does not move at all is calm: 1 nm/s.
    calm = _STILL * timestep * load + 1e-9
    value = values[world % values.shape[0], law]
    depth = found.margin[i] - found.dist[i]
    half = presses * timestep / 2.0
    parts = _parting(laws, laws.reading[law], value, -rate[0], depth, presses, timestep)
    # What neither collides nor parts comes no faster than it did: its own row lets it rest.
    target = wp.min(rate[0] - half, 0.0)
    if -rate[0] > calm:
        target = wp.min(parts, half - rate[0])
    room.rate[i] = rate - wp.vec3(half, 0.0, 0.0)
    room.own[i] = own
    room.target[i] = target
    room.calm[i] = calm
    room.load[i] = load


@wp.func
def _rate_of_change(room: Room, world: int, i: int, lane: int) -> wp.vec3:
    """Rates that the change of the velocities makes at contact i, m/s: the same in every lane of the
    block, of which each adds up its share of the velocities.
    """
    part = wp.vec3(0.0)
    for v in range(lane, room.change.shape[1], wp.block_dim()):
        part += room.rows[i, v] * room.change[world, v]
    return wp.tile_extract(wp.tile_sum(wp.tile(part, preserve_type=True)), 0)


@wp.func
def _impulse_of(
    room: Room, i: int, impulse: wp.vec3, change: wp.vec3, friction: wp.vec2
) -> wp.vec3:
    """Impulse, N s, that the law of contact i asks for, while those of the others stay.

    impulse: its last one.
    change: of its rates by all impulses so far, m/s.
    friction: coefficients along its two tangents; 0 for none.
    Components: normal, then tangents.
    """
    own = room.own[i]
    rate = room.rate[i] + change
    normal = wp.max(impulse[0] + (room.target[i] - rate[0]) / own[0, 0], 0.0)
    rate += own * wp.vec3(normal - impulse[0], 0.0, 0.0)
    most = friction * normal
    if most[0] <= 0.0 or most[1] <= 0.0:
        return wp.vec3(normal, 0.0, 0.0)
    # The stiffer tangent: a step by it overshoots neither.
    stiffest = wp.max(wp.max(own[1, 1], own[2, 2]), 1e-12)
    sliding = wp.vec2(impulse[1] - rate[1] / stiffest, impulse[2] - rate[2] / stiffest)
    share = wp.length(wp.vec2(sliding[0] / most[0], sliding[1] / most[1]))
    sliding = sliding / wp.max(share, 1.0)
    return wp.vec3(normal, sliding[0], sliding[1])


@wp.func
def _share(room: Room, world: int, lane: int) -> float:
    """Share of the impulses of a world, 0 to 1, that adds no energy: the same in every lane of the
    block.

    The work of impulses p s is s p.(u + s du/2), with u the rates before them and du their change:
    it is 0 at most up to s = -2 p.u / p.du.
    """
    before = float(0.0)
    between = float(0.0)
    i = room.first[world]
    while i >= 0:
        before += wp.dot(room.impulse[i], room.rate[i])
        between += wp.dot(room.impulse[i], _rate_of_change(room, world, i, lane))
        i = room.following[i]
    if between <= 0.0:
        return 0.0
    return wp.clamp(-2.0 * before / between, 0.0, 1.0)


@wp.kernel
def collide(found: Found, friction: wp.array[_Five], room: Room, qvel: wp.array2d[float]) -> None:
    """Let the contacts of each world collide, all at once: no contact parts slower than its target,
    those that part faster have no impulse, and friction stays within Coulomb's.

    found: dimension of each contact, 1 without friction.
    friction: coefficients of each contact, the first two along its tangents.
    room: contacts of a world, linked from `first` by `following` until -1, with their rates and
    targets, m/s.
    Impulses, N s, never add energy. Velocities after them are written to `qvel`, shape (worlds,
    velocities).

    A block of threads, of one on a CPU, has a world. Its lanes share out the velocities, and find
    the same impulses.
    """
    world, lane = wp.tid()
    first = room.first[world]
    # No contact of this world has collided.
    if first < 0:
        return
    velocities = room.change.shape[1]
    fastest = float(0.0)
    most = float(0.0)
    i = first
    while i >= 0:
        room.impulse[i] = wp.vec3(0.0)
        most = wp.max(most, wp.length(room.rate[i]))
        if room.own[i][0, 0] > 0.0:
            fastest = wp.max(fastest, room.target[i] - room.rate[i][0])
        i = room.following[i]
    if fastest <= 0.0:
        return
    for v in range(lane, velocities, wp.block_dim()):
        room.change[world, v] = 0.0
    settled = _SETTLED * fastest + _NOISE * most
    moved = 2.0 * settled
    sweeps = int(0)
    while moved > settled and sweeps < _SWEEPS:
        moved = float(0.0)
        sweeps += 1
        i = first
        while i >= 0:
            if room.own[i][0, 0] > 0.0:
                mu = wp.vec2(0.0)
                if found.dim[i] > 1:
                    mu = wp.vec2(friction[i][0], friction[i][1])
                # Read before the lanes wait for one another, and written after it.
                before = room.impulse[i]
                change = _rate_of_change(room, world, i, lane)
                new = _impulse_of(room, i, before, change, mu)
                delta = new - before
                moved = wp.max(moved, wp.max(wp.abs(wp.cw_mul(delta, wp.get_diag(room.own[i])))))
                room.impulse[i] = new
                for v in range(lane, velocities, wp.block_dim()):
                    room.change[world, v] += wp.dot(room.moves[i, v], delta)
            i = room.following[i]
    share = _share(room, world, lane)
    for v in range(lane, velocities, wp.block_dim()):
        qvel[world, v] += share * room.change[world, v]


@wp.kernel
def settle(
    found: Found,
    solimp: wp.array[_Five],
    timesteps: wp.array[float],
    qvel: wp.array2d[float],
    room: Room,
) -> None:
    """Silence the contacts that part, and let those that rest not bounce by their spring: changes
    `dist` and `solref` of `found`, which `restore` puts back. A thread for each contact.

    The spring is that of the model, with the damping that makes it critical at least. It gives
    depth back no faster than what counts as rest, but bears its load.

    found: the contacts; changed.
    room: rates and loads of the contacts.
    solimp: impedance of each contact, the first number at no depth.
    timesteps: s, of each world or one for all.
    qvel: velocities after the impulses, (worlds, nv).
    """
    i = wp.tid()
    if i >= found.count[0] or room.law[i] < 0:
        return
    world = found.world[i]
    timestep = timesteps[world % timesteps.shape[0]]
    rate = float(0.0)
    for v in range(room.change.shape[1]):
        rate += room.rows[i, v][0] * qvel[world, v]
    if rate > room.calm[i]:
        # A metre apart: the engine's solver gives it no force.
        found.dist[i] = found.margin[i] + 1.0
        return
    # MJCF's solref is (-stiffness, -damping) per unit mass, 1/s² and 1/s, or, where it is above 0,
    # (time constant s, damping ratio); the engine takes two steps at least for the time constant.
    solref = room.solref[i]
    stiffness = -solref[0]
    damping = -solref[1]
    if solref[0] > 0.0:
        constant = wp.max(solref[0], 2.0 * timestep)
        ratio = wp.max(solref[1], 1e-3)
        stiffness = 1.0 / (constant * ratio * constant * ratio)
        damping = 2.0 / constant
    # Up to this stiffness the critical damping, 2 sqrt(k), is at most 1/h, which stops the contact
    # in one step.
    stiffness = wp.min(stiffness, 0.25 / (timestep * timestep))
    damping = wp.clamp(damping, 2.0 * wp.sqrt(stiffness), 1.0 / timestep)
    # An impedance d gives way to (1 - d)/d of the load; 1e-4 is the least d that the engine takes.
    lets_by = 1.0 / wp.max(solimp[i][0], 1e-4) - 1.0
    load = room.load[i]
    most = wp.max(_RISE * _STILL * timestep * damping, _BEARS * lets_by) * load
    depth = found.margin[i] - room.dist[i]
    stiffness = wp.min(stiffness, most / wp.max(depth, 1e-9))
    found.solref[i] = wp.vec2(-stiffness, -damping)


@wp.kernel
def restore(found: Found, room: Room) -> None:
    """Give contacts the distances and springs that the engine found, for who reads them."""
    i = wp.tid()
    if i >= found.count[0] or room.law[i] < 0:
        return
    found.dist[i] = room.dist[i]
    found.solref[i] = room.solref[i]
