"""Restitution by impact speed in MJX: a step of a world, in place of `mujoco.mjx.step`.

    import jax
    from mujoco import mjx
    from hcbench.contact.mjx import restitution

    step = jax.jit(restitution(model, {("ball", "floor"): 0.3}))  # α, s/m
    data = step(mjx.put_model(model), data)

Contacts that touch and approach faster than their load moves them in a step collide at the start of
the step, all at once, with Coulomb friction, each with the e of its own approach. Contacts that part
then are silent for the step; those that rest stay MJX's own. The speeds that e is of are those of
the MuJoCo plug-in `hcbench.restitution` (`hcb_under_gravity` in `laws/collision.c`); that one lets
several contacts collide in rounds, here all of them have Newton's rule at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from hcbench.engines.mjx.engine import MjxEngine
from hcbench.sim.pair_laws import (
    BEARS,
    LAW,
    LINEAR,
    NUMBERS,
    RISE,
    STILL,
    SWEEPS,
    E,
    Laws,
    Pairs,
    laws_of,
)
from hcbench.system.errors import UserError
from hcbench.terms.arguments import checked

# The change, as a share of the fastest approach, below which sweeps over the contacts that collide
# have settled.
_SETTLED = 1e-6
# Contacts that one sweep, or several, are written out for in a compiled step.
_UNROLLED = 16

Step = Callable[..., Any]


class _Touch(NamedTuple):
    """Contacts of a world, n of them, as its laws see them.

    law: number of each contact's pair; -1 of contacts that touch nothing or have no law.
    depth: m.
    friction: Coulomb's coefficients along both tangents, (n, 2).
    rows: rates over velocities, (n, 3, nv); the first of each is along the normal, apart above 0.
    moves: M⁻¹ of the rows, (n, 3, nv).
    """

    law: Any
    depth: Any
    friction: Any
    rows: Any
    moves: Any


@checked
def restitution(model: Any, pairs: Pairs) -> Step:
    """Return `step(model, data)`, as `mujoco.mjx.step`, in which these pairs bounce by their law.

    Parameters
    ----------
    model : mujoco.MjModel
        The model that `mjx.put_model` got. Its integrator is Euler or implicitfast.
    pairs : mapping
        By two names of geoms, or of bodies, which stand for all their geoms ("world" for what is
        fixed): α in s/m, a `Restitution`, or a `ConstantRestitution`.

    Returns
    -------
    callable
        `step(model, data, values=None)` for MJX's `Model` and `Data` of one world, to `jax.jit` and
        `jax.vmap`. values: α (s/m) or e of each pair in the order of `pairs`, where worlds differ;
        those of `pairs` unless given.

    Raises
    ------
    EngineMissing
        Without MJX.
    UserError
        For another model, names that it lacks, and pairs given twice.
    SettingError
        For an option that no step of this kind has been tried with.

    """
    laws = laws_of(model, pairs)
    defaults = laws.values
    MjxEngine.backend.module("mujoco.mjx")

    def step(model: Any, data: Any, values: Any = None) -> Any:
        """MJX's Data after one step of its Model. values: of each pair's law; None: as given.

        Raises UserError for values of another shape.
        """
        from mujoco import mjx

        chosen = defaults if values is None else values
        if np.shape(chosen) != defaults.shape:
            got = f"an array of shape {np.shape(chosen)}"
            raise UserError("values", got, f"{defaults.shape}: one of each pair")
        data = _forward(laws, model, data, chosen)
        if model.opt.integrator == mjx.IntegratorType.EULER:
            return mjx.euler(model, data)
        return mjx.implicit(model, data)

    return step


def _forward(laws: Laws, model: Any, data: Any, values: Any) -> Any:
    """MJX's forward dynamics with the impacts at its start: the data with forces and accelerations
    of the step.

    model, data: MJX's.
    values: α or e of each law, (laws,).
    """
    from mujoco import mjx

    before = data
    data = mjx.fwd_position(model, data)
    contact = data._impl.contact
    if contact.dist.size:
        data = _collide(laws, model, before, data, values)
        data = mjx.make_constraint(model, data)
    data = mjx.sensor_pos(model, data)
    data = mjx.fwd_velocity(model, data)
    data = mjx.sensor_vel(model, data)
    data = mjx.fwd_actuation(model, data)
    data = mjx.fwd_acceleration(model, data)
    if data._impl.efc_J.size == 0:
        return data.replace(qacc=data.qacc_smooth)
    data = mjx.solve(model, data)
    # `_collide` changed the contacts for the solver alone: users see those that were detected.
    data = data.tree_replace({"_impl.contact": contact})
    return mjx.sensor_acc(model, data)


def _collide(laws: Laws, model: Any, before: Any, data: Any, values: Any) -> Any:
    """Let contacts collide: data with the velocities after it, and with contacts whose rows only
    let them rest.

    laws: of all pairs.
    model: MJX's.
    before: the data with the forces of the step before.
    data: that with the positions and contacts of this one.
    values: α or e of each law.
    """
    import jax.numpy as jnp

    touch = _touch(laws, model, data)
    timestep = model.opt.timestep
    # Of each contact apart and along both tangents, m/s, (n, 3).
    rates = touch.rows @ data.qvel
    # Acceleration that presses the two together, m/s², (n,): of gravity, motors and springs, as the
    # step before had them.
    presses = jnp.maximum(-(touch.rows[:, 0] @ data.qacc_smooth), 0.0)
    load = jnp.maximum(presses, _loads(model, touch, before, data))
    # Speed that counts as rest, m/s, with a margin for round-off.
    calm = STILL * timestep * load + 1e-9
    target, half = _targets(laws, touch, values, -rates[:, 0], presses, calm, timestep)
    shifted = rates.at[:, 0].add(-half)
    impulse = _impulses(touch, shifted, target)
    qvel = data.qvel + jnp.einsum("nk,nkv->v", impulse, touch.moves)
    # Apart, after the impacts, m/s: what parts is silent for the step, what rests is MJX's.
    rate = touch.rows[:, 0] @ qvel
    contact = _resting(data._impl.contact, touch, rate > calm, load, timestep)
    return data.replace(qvel=qvel).tree_replace({"_impl.contact": contact})


def _touch(laws: Laws, model: Any, data: Any) -> _Touch:
    """All contacts of a world as its laws see them; `law` is -1 of those that touch nothing or have
    no law.

    model, data: MJX's, with the contacts of the state.
    """
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    contact = data._impl.contact
    body_of = jnp.array(model.geom_bodyid)

    def rows_of(point: Any, frame: Any, geom: Any) -> Any:
        """Rates of one contact over velocities, (3, nv): apart, then along both tangents."""
        one, _ = mjx.jac(model, data, point, body_of[geom[0]])
        two, _ = mjx.jac(model, data, point, body_of[geom[1]])
        return frame @ (two - one).T

    rows = jax.vmap(rows_of)(contact.pos, contact.frame, contact.geom)
    depth = contact.includemargin - contact.dist
    law = jnp.array(laws.pair_of)[contact.geom[:, 0], contact.geom[:, 1]]
    law = jnp.where(depth > 0.0, law, -1)
    friction = contact.friction[:, :2] * (jnp.array(contact.dim) > 1)[:, None]
    # MJX keeps a dense M⁻¹ as its Cholesky factor.
    if mjx.is_sparse(model):
        factor = jax.scipy.linalg.cho_factor(mjx.full_m(model, data))
    else:
        factor = (data._impl.qLD, False)
    moves = jax.scipy.linalg.cho_solve(factor, rows.reshape(-1, model.nv).T).T
    return _Touch(law, depth, friction, rows, moves.reshape(rows.shape))


def _loads(model: Any, touch: _Touch, before: Any, data: Any) -> Any:
    """Accelerations that each contact bears, or would have without its own force, m/s², (n,): of
    the weight of either body alone, and of all other forces of the step before.

    model: MJX's.
    touch: the contacts of this step.
    before, data: MJX's data of the step before, and of this one.
    A foot may be pressed through a joint's limit, a body by others that lie on it: of that, gravity
    and motors alone tell nothing.
    """
    import jax.numpy as jnp

    contact = data._impl.contact
    normal = contact.frame[:, 0]
    # Which of a contact's two bodies can move, (n, 2).
    moves = jnp.array(model.body_weldid != 0)[jnp.array(model.geom_bodyid)[contact.geom]]
    # The normal points from the first body to the second.
    along = normal @ model.opt.gravity
    weight = jnp.maximum(along * moves[:, 0], -along * moves[:, 1])
    # What the contact's own force gave, m/s²: its mobility, 1/kg, times the force. Without it the
    # two would have approached by the rest.
    mobility = jnp.einsum("nv,nv->n", touch.rows[:, 0], touch.moves[:, 0])
    own = mobility * _normal_forces(model, before)
    others = own - touch.rows[:, 0] @ before.qacc
    return jnp.maximum(jnp.maximum(weight, others), 0.0)


def _normal_forces(model: Any, data: Any) -> Any:
    """Forces along the normals of all contacts in the last step, N, (n,).

    model, data: MJX's, after that step.
    A contact has the same place in every step.
    """
    import jax.numpy as jnp
    from mujoco import mjx

    contact = data._impl.contact
    force = data._impl.efc_force
    if force.size == 0:
        return jnp.zeros_like(contact.dist)
    of_normal = []
    for dim, row in zip(contact.dim, contact.efc_address, strict=True):
        # The edges of a pyramid share the normal's force.
        is_pyramid = dim > 1 and model.opt.cone == mjx.ConeType.PYRAMIDAL
        edges = 2 * (dim - 1) if is_pyramid else 1
        of_normal.append(jnp.sum(force[row : row + edges]))
    return jnp.stack(of_normal)


def _targets(
    laws: Laws,
    touch: _Touch,
    values: Any,
    approach: Any,
    presses: Any,
    calm: Any,
    timestep: Any,
) -> tuple[Any, Any]:
    """(rates at which contacts part at least, the half step's push by which they are shifted), m/s,
    (n,) each.

    laws: of all pairs.
    touch: the contacts, n of them.
    values: α or e of each law.
    approach: v, m/s.
    presses: b, m/s².
    calm: speed that counts as rest, m/s.
    timestep: h, s. Steps that move by the new velocity keep U² = (v + b h/2)² - 2 b x in flight, U
    the speed at the touch plane x = 0, which e is of. A contact that touched before this step has
    the e of v.
    """
    import jax.numpy as jnp

    half = presses * timestep / 2.0
    # No deeper than the last step led: it touched within this step. Float32 rounds the depth.
    is_new = touch.depth <= timestep * approach * (1.0 + 1e-5)
    lift = jnp.where(is_new, 2.0 * presses * touch.depth, 0.0)
    speed = approach + half
    at_plane = jnp.where(is_new, jnp.sqrt(jnp.maximum(speed**2 - lift, 0.0)), approach)
    # α or e of each contact's law, and the number α v by which e falls; else the value is e itself.
    value = jnp.asarray(values)[touch.law]
    number = value * at_plane
    e = jnp.select(
        [jnp.array(laws.readings == reading)[touch.law] for reading in (LAW, LINEAR)],
        [jnp.interp(number, jnp.array(NUMBERS), jnp.array(E)), 1.0 - number],
        value,
    )
    out = jnp.clip(e, 0.0, 1.0) * at_plane
    parts = jnp.where(is_new, jnp.sqrt(out**2 + lift), out - half)
    collides = approach > calm
    # What neither collides nor parts comes no faster than it did: its own row lets it rest.
    target = jnp.where(collides, jnp.minimum(parts, speed), jnp.minimum(-speed, 0.0))
    return jnp.where(touch.law >= 0, target, -jnp.inf), half


def _impulses(touch: _Touch, rates: Any, target: Any) -> Any:
    """Impulses along the rows, N s, (n, 3): no contact parts slower than its target, those that part
    faster have none, and friction stays within Coulomb's. They never add energy.

    touch: the contacts, n of them.
    rates: before them, m/s, (n, 3).
    target: m/s, (n,).
    """
    import jax
    import jax.numpy as jnp

    count = target.size
    # Sweeps in one compiled round.
    together = max(1, _UNROLLED // count)
    # Rate of row k of contact i by a unit impulse along row l of contact j, 1/kg, (n, 3, n, 3); and
    # of each row by its own impulse, (n, 3), with the inverse, 0 for rows that nothing moves.
    couples = jnp.einsum("ikv,jlv->ikjl", touch.rows, touch.moves)
    own = jnp.einsum("ikik->ik", couples)
    acts = (touch.law >= 0) & (own[:, 0] > 0.0)
    # The inner `where` keeps a division by 0 out of the branch that is not taken.
    ease = jnp.where(own > 0.0, 1.0 / jnp.where(own > 0.0, own, 1.0), 0.0)
    # The largest change that is asked for, m/s, by which the sweeps are judged.
    fastest = jnp.max(jnp.where(acts, jnp.maximum(target - rates[:, 0], 0.0), 0.0))

    def solve_contact(i: Any, carry: Any) -> Any:
        """Give contact i the impulse that its law asks for, while those of the others stay.

        carry: (impulses of all, N s; the largest change of a rate so far, m/s).
        """
        impulse, change = carry
        rate = rates[i] + jnp.einsum("kjl,jl->k", couples[i], impulse)
        normal = jnp.maximum(impulse[i, 0] + (target[i] - rate[0]) * ease[i, 0], 0.0)
        rate = rate + couples[i, :, i, 0] * (normal - impulse[i, 0])
        # The stiffer tangent: a step by it overshoots neither.
        sliding = impulse[i, 1:] - rate[1:] * jnp.min(ease[i, 1:])
        # Within Coulomb's ellipse: beyond it (a share above 1) the impulse is scaled back onto it.
        most = touch.friction[i] * normal
        share = jnp.linalg.norm(sliding / jnp.where(most > 0.0, most, 1.0))
        sliding = jnp.where(most > 0.0, sliding / jnp.maximum(share, 1.0), 0.0)
        new = jnp.where(acts[i], jnp.concatenate([normal[None], sliding]), 0.0)
        moved = jnp.max(jnp.abs(new - impulse[i]) * own[i])
        return impulse.at[i].set(new), jnp.maximum(change, moved)

    def sweep(carry: Any) -> Any:
        """Go over all contacts together so many times: a GPU waits at each look whether all is
        settled, and runs unrolled sweeps in one kernel.
        """
        impulse, _, sweeps = carry
        for _ in range(together):
            start = impulse, jnp.zeros_like(fastest)
            unroll = count <= _UNROLLED or None
            impulse, change = jax.lax.fori_loop(0, count, solve_contact, start, unroll=unroll)
        return impulse, change, sweeps + together

    def goes_on(carry: Any) -> Any:
        """Say whether the last sweep still changed a rate, and sweeps are left."""
        _, change, sweeps = carry
        return (change > _SETTLED * fastest) & (sweeps < SWEEPS)

    impulse, _, _ = jax.lax.while_loop(goes_on, sweep, (jnp.zeros_like(rates), fastest, 0))
    # Work of the impulses: p.(u before + u after)/2, which a share of them makes 0 at most.
    before = jnp.sum(impulse * rates)
    change = jnp.einsum("ik,ikjl,jl->", impulse, couples, impulse)
    most = jnp.where(change > 0.0, -2.0 * before / jnp.where(change > 0.0, change, 1.0), 0.0)
    return jnp.clip(most, 0.0, 1.0) * impulse


def _resting(contact: Any, touch: _Touch, parts: Any, load: Any, timestep: Any) -> Any:
    """Contacts for MJX's own rows: those of a law that part have none, and those that rest do not
    bounce by their spring.

    touch: the contacts, n of them, as the laws see them.
    contact: MJX's.
    parts: which of them part, (n,).
    load: of each, m/s².
    timestep: s.
    The spring is that of the model, with the damping that makes it critical at least. It gives
    depth back no faster than what counts as rest, but bears its load.
    """
    import jax.numpy as jnp

    has_law = touch.law >= 0
    # solref is (-stiffness, -damping), or (time constant, damping ratio): MuJoCo takes no constant
    # below two steps.
    is_direct = contact.solref[:, 0] <= 0.0
    constant = jnp.maximum(contact.solref[:, 0], 2.0 * timestep)
    ratio = jnp.maximum(contact.solref[:, 1], 1e-3)
    stiffness = jnp.where(is_direct, -contact.solref[:, 0], 1.0 / (constant * ratio) ** 2)
    damping = jnp.where(is_direct, -contact.solref[:, 1], 2.0 / constant)
    # Critical damping 2 √k is at most 1/h, at which a damper stops a body in one step.
    stiffness = jnp.minimum(stiffness, 0.25 / timestep**2)
    damping = jnp.clip(damping, 2.0 * jnp.sqrt(stiffness), 1.0 / timestep)
    # (1 - d)/d of the impedance d: the share of the load that the row leaves to its spring.
    lets_by = 1.0 / jnp.maximum(contact.solimp[:, 0], 1e-4) - 1.0
    # Largest acceleration of the spring, m/s².
    most = jnp.maximum(RISE * STILL * timestep * damping, BEARS * lets_by) * load
    stiffness = jnp.minimum(stiffness, most / jnp.maximum(touch.depth, 1e-9))
    solref = jnp.stack([-stiffness, -damping], axis=1)
    # A contact this far away, m, makes no row.
    away = contact.includemargin + 1.0
    return contact.replace(
        dist=jnp.where(has_law & parts, away, contact.dist),
        solref=jnp.where(has_law[:, None], solref, contact.solref),
    )
