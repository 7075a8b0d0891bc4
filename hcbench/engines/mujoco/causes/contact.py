"""MuJoCo: causes in the parameters of the contact, which do not arrive as written or ask for no bounce."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.causes import fixes
from hcbench.engines.mujoco.causes.context import DEFAULT_SOLREF, FLOOR_SHIFT, explicit_pair, overridden, same
from hcbench.engines.mujoco.model import geom_name
from hcbench.engines.mujoco.rows import MAX_IMPEDANCE, MAX_POWER, MIN_IMPEDANCE, STIFF_SOLIMP
from hcbench.sim.model_under_test import Suspect

if TYPE_CHECKING:
    from collections.abc import Iterator

    from hcbench.engines.mujoco.causes.context import Context


def mixing(s: Context) -> Iterator[Suspect]:
    """The geoms' parameters do not arrive as written."""
    if s.asked is None or (explicit_pair(s.model, s.geoms) >= 0 and not overridden(s.model)):
        return
    solref, solimp, _ = s.place.contact.rows[0]
    names = [geom_name(s.model, g) for g in s.geoms]
    apply = partial(fixes.set_contact, geoms=s.all_geoms, solref=s.asked.solref, solimp=s.asked.solimp)
    if overridden(s.model):
        yield Suspect(
            "override",
            "The override flag replaces every contact's solref and solimp.",
            f"o_solref {fixes.numbers(solref)}, o_solimp {fixes.numbers(solimp)}",
            '<option><flag override="disable"/></option>',
            fixes.no_override,
        )
        return
    ranks = [int(s.model.geom_priority[g]) for g in s.geoms]
    lost = not (same(solref, s.asked.solref) and same(solimp, s.asked.solimp))
    if lost and ranks[0] != ranks[1]:
        winner = int(ranks[1] > ranks[0])
        yield Suspect(
            "priority",
            f"Geom {names[winner]!r} has priority: the parameters of {names[1 - winner]!r} are not used.",
            f"priority {ranks[winner]} over {ranks[1 - winner]}; solref is now {fixes.numbers(solref)}",
            f'{names[1 - winner]}: priority="{ranks[winner] + 1}"',
            apply,
        )
        return
    if not same(solref, s.asked.solref):
        yield Suspect(
            "solref-mixing",
            "MuJoCo mixes the solref of the two geoms: the contact does not have the one written.",
            f"written {fixes.numbers(s.asked.solref)}, in the contact {fixes.numbers(solref)}",
            f'{s.names}: solref="{fixes.numbers(s.asked.solref)}"',
            apply,
        )
    if not same(solimp, s.asked.solimp):
        yield Suspect(
            "solimp-mixing",
            "MuJoCo averages the solimp of the two geoms: the contact does not have the one written.",
            f"written {fixes.numbers(s.asked.solimp)}, in the contact {fixes.numbers(solimp)}",
            f'{s.names}: solimp="{fixes.numbers(s.asked.solimp)}"',
            apply,
        )


def refsafe(s: Context) -> Iterator[Suspect]:
    """A time constant below two steps is not honoured."""
    solref = s.place.contact.rows[0][0]
    mujoco = backend()
    if solref[0] <= 0 or s.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_REFSAFE:
        return
    discrete = s.integrator == "discrete"
    constant = solref[0] * solref[1] if discrete else solref[0]
    if constant >= (s.timestep if discrete else 2 * s.timestep):
        return
    step = constant * min(0.1, math.pi * solref[1] / 40)  # some 40 steps a contact
    yield Suspect(
        "refsafe",
        "The time constant is too short for the step: refsafe replaces it by a longer, softer one.",
        f"solref {fixes.numbers(solref)} at a step of {s.timestep:g} s: "
        + ("no bounce is left" if discrete else f"{2 * s.timestep:g} s is used"),
        f'<option timestep="{step:.6g}"/>',
        partial(fixes.set_timestep, timestep=step),
    )


def damped(s: Context) -> Iterator[Suspect]:
    """The contact is asked for, as written, less bounce than is wanted."""
    if s.asked is None:
        return
    default = same(s.asked.solref, DEFAULT_SOLREF)
    goal = s.goal()
    promised = s.asked.restitution(float(np.median([i.launch.speed for i in s.impacts])))
    certain = default or s.asked.is_powerless
    if not certain and (s.wanted is None or abs(promised - goal) < FLOOR_SHIFT):
        return
    solref, solimp, more = fixes.bouncy(goal, s.timestep, s.integrator)
    code, title = "damped-solref", "solref asks for more damping than the wanted bounce has."
    if default:
        code, title = (
            "default-solref",
            ("solref is MuJoCo's default, critically damped: it asks for next to no bounce."),
        )
    elif s.asked.is_powerless:
        code, title = "no-push", "solref asks for neither a spring nor a damper: nothing pushes back."
    elif promised > goal:
        code, title = "lively-solref", "solref asks for less damping than the wanted bounce has."
    yield Suspect(
        code,
        title,
        f"solref {fixes.numbers(s.asked.solref)} promises e = {promised:.3g}",
        f'{s.names}: solref="{fixes.numbers(solref)}" solimp="{fixes.numbers(solimp)}"'
        f" (e = {goal:.3g}{more})",
        partial(fixes.set_bouncy, geoms=s.all_geoms, e=goal),
        always_reported=certain,
        apply_last=True,
        assumed_e=None if s.wanted is not None else goal,
    )


def impedance(s: Context) -> Iterator[Suspect]:
    """solimp takes a share off spring and damper, or is clamped."""
    law = s.delivered
    if law is None or s.asked is None:
        return
    if s.asked.overflows:
        yield Suspect(
            "solimp-power",
            "The power of solimp is too high: MuJoCo's sigmoid underflows and gives not-a-number.",
            f"solimp {fixes.numbers(s.asked.solimp)}",
            f"{s.names}: a power below {MAX_POWER:g} in solimp",
            always_reported=True,
        )
        return
    d0, dw = s.asked.impedance(0.0), s.asked.impedance(math.inf)
    apply = partial(fixes.set_contact, geoms=s.all_geoms, solref=None, solimp=STIFF_SOLIMP)
    if law.solref[0] <= 0 and d0 < dw:
        yield Suspect(
            "impedance",
            "solimp starts below its final value: at touch the contact has but a share of its strength.",
            f"impedance {d0:.4g} at touch, {dw:.4g} at depth",
            f'{s.names}: solimp="{fixes.numbers(STIFF_SOLIMP)}"',
            apply,
        )
    low, high = min(s.asked.solimp[:2]), max(s.asked.solimp[:2])
    if low >= MIN_IMPEDANCE and high <= MAX_IMPEDANCE:
        return
    speeds = sorted({i.launch.speed for i in s.impacts})
    held_law = replace(law, solimp=s.asked.solimp, clamped=True)
    held, loose = held_law.curve(speeds), replace(held_law, clamped=False).curve(speeds)
    worst = int(np.argmax(np.abs(np.subtract(loose, held))))
    if abs(loose[worst] - held[worst]) > FLOOR_SHIFT:
        goal = float(np.mean(loose))
        solref, solimp, more = fixes.bouncy(goal, s.timestep, s.integrator)
        yield Suspect(
            "impedance-floor",
            f"solimp is not used as written: impedances are held to {MIN_IMPEDANCE:g} ... {MAX_IMPEDANCE:g}.",
            f"solimp {fixes.numbers(s.asked.solimp)}: at {speeds[worst]:.3g} m/s e = {held[worst]:.3g} "
            f"where {loose[worst]:.3g} was written",
            f'{s.names}: solref="{fixes.numbers(solref)}" solimp="{fixes.numbers(solimp)}"'
            f" (e = {goal:.3g}{more})",
            partial(fixes.set_bouncy, geoms=s.all_geoms, e=goal),
            always_reported=True,
            apply_last=True,
        )
