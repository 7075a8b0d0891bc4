"""MuJoCo: any model with a pair in it, measured as its author has it."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.mujoco.backend import backend, plugin_warnings
from hcbench.engines.mujoco.model.bodies import (
    body_name,
    geom_friction,
    geom_name,
    mixed_friction,
    volumes,
)
from hcbench.engines.mujoco.model.causes import find_suspects
from hcbench.engines.mujoco.model.causes.contact import WEAK, pyramidal_cone
from hcbench.engines.mujoco.model.causes.context import Context, written_contact
from hcbench.engines.mujoco.model.causes.motion import at_rest
from hcbench.engines.mujoco.model.find_pair import moving_joints
from hcbench.engines.mujoco.model.open import OpenedModel
from hcbench.engines.mujoco.model.pair import restitution_law
from hcbench.engines.mujoco.model.promises import broken_promise, promise_in, slow_for_plugin
from hcbench.engines.mujoco.model.shared_model import LentModel
from hcbench.engines.mujoco.model.simulation import Flights, simulation_of
from hcbench.engines.mujoco.model.standing import carried_by, rest_of_pair
from hcbench.laws.restitution import RestitutionCurve
from hcbench.measuring.diagnose import other_contacts
from hcbench.sim import simulate
from hcbench.sim.model_under_test import Facts, Suspect, unit_notes
from hcbench.sim.promise import Promise
from hcbench.sim.shared_model import LendsSteps
from hcbench.sim.touch import overlap_notes
from hcbench.terms.impact import Impact, Launch

if TYPE_CHECKING:
    from hcbench.sim.rest import Carried, Rest
    from hcbench.sim.shared_model import SharedModelEngine

# Last part of the approach, in sizes of the smaller body, over which a distance is compared with
# the way; and the difference, as a share, from which MuJoCo's distance counts as rough.
_LAST_PART = 0.01
_ROUGH = 0.03
# Relative difference of two frictions that the digits of XML make.
_SAME_FRICTION = 1e-6


class MujocoModel(OpenedModel, LendsSteps):
    """A MuJoCo model with a pair in it, measured by MuJoCo's own steps, with its facts and
    suspects.
    """

    def release(self, launches: Sequence[Launch]) -> Flights[Any]:
        """The launches under way from their starting points."""
        return simulation_of(self, launches, self.speed_reading.steps_after)

    def follow(self, launch: Launch) -> Flights[Any]:
        """One launch, stepped on after it has parted."""
        return simulation_of(self, [launch], None)

    def stepped_by(self, engine: SharedModelEngine) -> LentModel:
        """The same pair, stepped by another engine."""
        return LentModel(self, engine)

    def facts(self) -> Facts:
        """Properties of the model and of its pair, SI, as `measure` prints them: the pair, its mass
        and its normal, from the body that moves, MuJoCo's settings, the e that these ask for, by
        whom, notes, and what has changed since `tune` wrote them.

        Warnings, notes on other contacts, and shares of the energy that went elsewhere are those of
        the launches until now.
        """
        model = self.model
        place = self.place
        asked, words = self._asked()
        point = place.contact.rows[0]
        geoms = point.geoms
        integrator = backend().mjtIntegrator(model.opt.integrator).name
        settings = {
            "integrator": integrator.removeprefix("mjINT_").lower(),
            "solref": list(point.solref),
            "solimp": list(point.solimp),
            "points of contact": len(place.contact.rows),
            "acts from (m)": place.contact.onset,
            "start": self.start_name,
        }
        return Facts(
            engine="mujoco",
            version=backend().__version__,
            model=self.label,
            pair=(_shown(model, place.pair.first, geoms), _shown(model, place.pair.second, geoms)),
            moved=place.joint.description + self._other_ways(),
            timestep=float(model.opt.timestep),
            gravity=tuple(map(float, self._gravity())),  # type: ignore[arg-type]
            effective_mass=place.effective_mass,
            normal=tuple(map(float, place.contact.normal)),  # type: ignore[arg-type]
            settings=settings,
            asked=asked,
            asked_description=words,
            notes=tuple(self._notes()),
            warnings=plugin_warnings(self.warned),
            point=tuple(map(float, place.contact.point)),  # type: ignore[arg-type]
            shares=dict(self.shares),
            friction=geom_friction(model, geoms),
            promise=self._promise(),
            changed=tuple(suspect.code for suspect in self._changed_since_tuned()),
        )

    def _asked(self) -> tuple[tuple[float, ...], str]:
        """e that the model asks for at each launch speed, and a phrase of what asks for it.

        It is that of the restitution plug-in; else that of the promise of `hcbench tune`; else that
        of the author's solref and solimp; () where those of several points differ.
        """
        speeds = self.request.speeds
        law = restitution_law(self.model, self.place.contact.geoms)
        if law is not None:
            words = f"plug-in hcbench.restitution: {law.description}"
            return _e_at(law, speeds), words
        promise = self._promise()
        written, words = written_contact(self.place)
        if promise is not None:
            words = f"{promise.setting} by hcbench: {promise.curve.description}"
            return _e_at(promise.curve, speeds), words
        if written is None:
            return (), words
        return written.curve(speeds), words

    def _other_ways(self) -> str:
        """A hint how to launch another body, where this one was chosen of several."""
        several = len(moving_joints(self.model, self.place.pair.first.body)) > 1
        return " (--move chooses)" if self.request.move is None and several else ""

    def _promise(self) -> Promise | None:
        return promise_in(self.model, self.place.contact.geoms)

    def _gravity(self) -> Sequence[float]:
        off = self.model.opt.disableflags & backend().mjtDisableBit.mjDSBL_GRAVITY
        return (0.0, 0.0, 0.0) if off else self.model.opt.gravity

    def _notes(self) -> list[str]:
        """Sentences that a reader of the numbers must know: how the two were brought together, what
        MuJoCo computes roughly, warnings, and what else touched in the launches until now.
        """
        notes = []
        if self.place.note:
            notes.append(self.place.note)
        notes += overlap_notes(self.place.overlap)
        notes += self._unit_notes()
        notes += self._friction_of_geoms()
        if self.model.nflex:
            notes.append("The model has flexes, which act, but only geoms are measured.")
        slope = self._distance_slope() - 1.0
        if abs(slope) > _ROUGH:
            notes.append(
                f"MuJoCo's distance of the two falls by {1.0 + slope:.3g} m in a metre of approach:"
                " it is rough for these shapes, and so is e."
            )
        notes += plugin_warnings(self.warned)
        if self.others:
            notes.append(f"Other contacts acted during the impact: {', '.join(self._others())}.")
        return notes

    def _unit_notes(self) -> list[str]:
        """A list of one sentence, if the density of the moving body shows that the model is not in
        metres and kilograms; else empty.
        """
        body = self.place.pair.first.body
        root = int(self.model.body_rootid[body])
        mass = float(self.model.body_subtreemass[root])
        data = copy.copy(self.start)
        backend().mj_kinematics(self.model, data)
        name = body_name(self.model, root)
        return unit_notes(name, mass, *volumes(self.model, data, body))

    def _friction_of_geoms(self) -> list[str]:
        """A list of one sentence, if the <pair>s that hcbench wrote have another friction than the
        geoms would have without them; else empty.
        """
        promise = self._promise()
        if promise is None or not promise.rows:
            return []
        geoms = self.place.contact.geoms
        own = mixed_friction(self.model, geoms)
        now = geom_friction(self.model, geoms)
        if abs(own - now) <= _SAME_FRICTION * own:
            return []
        return [
            f"The pair by hcbench has friction {now:.4g}, its geoms alone {own:.4g}: "
            f"`hcbench tune mujoco --friction {own:.4g}` writes theirs."
        ]

    def _distance_slope(self) -> float:
        """Change of MuJoCo's distance of the two over the way of the last part of the approach, m/m:
        1 where the distance is exact, and where MuJoCo has no distance of such shapes.
        """
        place = self.place
        data = copy.copy(self.start)
        if not np.isfinite(place.gap):
            return 1.0
        back = _LAST_PART * place.pair.size  # m
        data.qpos[:] = place.qpos
        backend().mj_integratePos(self.model, data.qpos, place.direction, -back)
        backend().mj_fwdPosition(self.model, data)
        return (place.pair.nearest(data).distance - place.gap) / back

    def at_rest(self) -> Rest | None:
        """Measure the pair at rest in plain steps: from the start if the
        two touch there, else laid on.
        """
        return rest_of_pair(self)

    def carried(self) -> Carried:
        """Measure which loads the pair carries at rest, on its plate and on a slope."""
        return carried_by(self)

    def rest_suspects(self) -> list[Suspect]:
        """A contact that is soft, and one that its step is too long for."""
        return list(at_rest(Context(self.place, (), None, tuple(self._gravity()))))

    def suspects(self, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> list[Suspect]:
        """Suspects that may keep this pair from bouncing as wanted, likeliest first.

        impacts: of the launches.
        wanted: e over speed; None where the user named none.
        If the plug-in hcbench.restitution acts on the pair, only what concerns the plug-in is
        suspected; if a promise of `hcbench tune` is broken, only that; and other contacts in either
        case.
        """
        changed = self._changed_since_tuned()
        if (law := restitution_law(self.model, self.place.contact.geoms)) is not None:
            # Every other cause is one of MuJoCo's own contact, which the plug-in replaces.
            slow = slow_for_plugin(self.model, impacts, law, self.gravity)
            return [*changed, *slow, *other_contacts(self._others())]
        if changed:
            return [*changed, *other_contacts(self._others())]
        context = Context(self.place, impacts, wanted, tuple(self._gravity()), self.shares)
        return [
            *find_suspects(context),
            *self._weak_friction(impacts),
            *other_contacts(self._others()),
        ]

    def _changed_since_tuned(self) -> list[Suspect]:
        """Suspects that break the promise that `hcbench tune` wrote for this pair; empty without a
        promise.
        """
        promise = self._promise()
        if promise is None:
            return []
        geoms = self.place.contact.geoms
        gravity = float(np.linalg.norm(self._gravity()))
        contacts = len(self.place.contact.rows)
        return list(broken_promise(self.model, promise, geoms, gravity, contacts))

    def _weak_friction(self, impacts: Sequence[Impact]) -> list[Suspect]:
        """Suspect the pyramidal cone, if friction takes more in a copy with an elliptic one: a list
        of at most one.

        impacts: of the launches; the one whose friction is weakest is simulated again in the copy.
        """
        friction = geom_friction(self.model, self.place.contact.geoms)
        found = pyramidal_cone(self.model, impacts, friction)
        if found is None:
            return []
        weakest, suspect = found
        # The same launch once more, with an elliptic cone.
        (tried,) = simulate.impacts_in(self.fixed([suspect]), [weakest.launch])
        if tried.tangential is None or weakest.tangential is None:
            return []
        # Impulse of friction over that of the contact's normal.
        before = weakest.tangential.impulse_ratio
        after = tried.tangential.impulse_ratio
        if after - before < WEAK * friction:
            return []
        evidence = (
            f"friction takes {before:.3g} of the normal impulse, {after:.3g} with an elliptic cone"
        )
        return [dataclasses.replace(suspect, evidence=f"{evidence}; by Coulomb's law {friction:g}")]

    def _others(self) -> list[str]:
        return self.place.pair.names_of_others(self.others)

    def fixed(self, suspects: Sequence[Suspect]) -> MujocoModel:
        """The same pair in a copy of the model with the fixes of `suspects` made.

        Fixes that depend on others, such as on the step, come last.
        Raises UserError where the pair can no longer be brought to touch.
        """
        model = copy.copy(self.model)
        # False sorts before True.
        for suspect in sorted(suspects, key=lambda suspect: suspect.apply_last):
            if suspect.apply is not None:
                suspect.apply(model)
        return MujocoModel(model, self.label, self.state, self.request)


def _e_at(curve: RestitutionCurve, speeds: Sequence[float]) -> tuple[float, ...]:
    """e of a curve at each impact speed, m/s."""
    return tuple(float(curve.at(v)) for v in speeds)


def _shown(model: Any, side: Any, geoms: tuple[int, int]) -> str:
    if not side.name.startswith(("body:", "geom:")):
        return str(side.name)
    mine = next(g for g in geoms if g in side.geoms)
    return geom_name(model, mine)
