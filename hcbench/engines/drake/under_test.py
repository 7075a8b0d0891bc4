"""Drake: a file that it loads with a pair in it, in a discrete plant, measured as loaded."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, MutableMapping, Sequence
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.engines.drake.user_model import (
    DISSIPATION,
    STIFFNESS,
    LoadedPlant,
    Part,
    approach_row,
    bring_to_touch,
    ignored_in_words,
    move_on,
    movers,
    set_pose,
)
from hcbench.laws.closed_form import alpha_of
from hcbench.laws.restitution import Restitution
from hcbench.measuring import diagnose
from hcbench.sim.model_under_test import CandidatePair, Facts, ModelUnderTest, Suspect, in_order
from hcbench.sim.touch import overlap_notes
from hcbench.sim.world import Record, Simulation
from hcbench.system.errors import UserError
from hcbench.system.text import joined_names

if TYPE_CHECKING:
    from hcbench.laws.restitution import RestitutionCurve
    from hcbench.sim.model_under_test import Request
    from hcbench.sim.world import Flags
    from hcbench.terms.impact import Impact, Launch

# A step's own damping must take this much of e to be named.
_NOTABLE = 0.01
# With the fix it may take this much of e.
_TAKEN = 0.002
# A fix divides the step into at most so many parts: each takes as long as the step.
_FINEST = 30


class DrakeModel(ModelUnderTest):
    """A plant of a user's files with a pair in it, measured by Drake's own Simulator.

    drake: the module pydrake.all.
    version: of Drake.
    source: one path or several.
    changes: what fixes have set, "timestep" (s) and "dissipation" (s/m); {} for the model as it is.
    loaded: the plant.
    root, context: Drake's contexts of the diagram and, in it, of the plant.
    place: of the pair at touch.
    others: names of what else touched the two.

    Raises UserError or SceneError with the reason where the pair cannot be measured.
    """

    diverged = "Drake's solver gave up, or the state is not finite"

    def __init__(
        self, drake: Any, version: str, source: Any, request: Request, changes: Mapping[str, Any]
    ) -> None:
        """Load the files and bring the pair to touch.

        drake: the module pydrake.all.
        version: of Drake.
        source: one path or several.
        changes: what fixes have set, {} for none.
        Raises UserError or SceneError where the pair cannot be measured.
        """
        _require_normal_launches(request)
        # To make the model again with other changes.
        self._given = drake, version, source, request
        self._version = version
        self._changes = dict(changes)
        self.request = request
        self.loaded = LoadedPlant(drake, source, request, changes)
        self.root = self.loaded.diagram.CreateDefaultContext()
        self.context = self.loaded.plant.GetMyMutableContextFromRoot(self.root)
        set_pose(self.loaded, self.context, request)
        self.place = bring_to_touch(self.loaded, self.context, request)
        self.timestep = float(self.loaded.config.time_step)
        self.mass = self.place.effective_mass
        self.gravity = self.place.gravity
        self.others: set[str] = set()

    def release(self, launches: Sequence[Launch]) -> DrakeSimulation:
        """The launch under way."""
        (launch,) = launches
        return DrakeSimulation(self, launch)

    @property
    def step_cost(self) -> float:
        """Cost of a Simulator's step with what Python reads after it;
        grows with the degrees of freedom.
        """
        return 20.0 + float(self.loaded.plant.num_velocities())

    def pair_values(self) -> tuple[float, float]:
        """Stiffness, N/m, and dissipation, s/m, of the pair's point contact, as Drake combines those
        of the two shapes: springs in series, and the softer shape's dissipation counts more.
        """
        first, second = self.place.gap.geometries
        k1 = self.loaded.property(first, STIFFNESS)
        d1 = self.loaded.property(first, DISSIPATION)
        k2 = self.loaded.property(second, STIFFNESS)
        d2 = self.loaded.property(second, DISSIPATION)
        total = max(k1 + k2, np.finfo(float).tiny)
        return k1 * k2 / total, (k2 * d1 + k1 * d2) / total

    def _is_point_contact(self) -> bool:
        return not all(map(self.loaded.is_hydroelastic, self.place.gap.geometries))

    def facts(self) -> Facts:
        """Properties of the model and of its pair, SI, as `measure` prints them: the pair, its mass
        and normal, Drake's settings, the e that these ask for, and notes.

        The e is known where the contact is a point's, not a pressure field's. Other contacts are
        those of the launches until now.
        """
        config = self.loaded.config
        place = self.place
        stiffness, dissipation = self.pair_values()
        asked: tuple[float, ...] = ()
        words = ""
        # A pressure field has no closed form.
        if self._is_point_contact():
            curve = Restitution(dissipation / 1.5)
            asked = tuple(float(curve.at(v)) for v in self.request.speeds)
            words = f"dissipation {dissipation:.4g} s/m: the law's e with d = 1.5 α"
        notes = [ignored_in_words(self.loaded.ignored), *overlap_notes(place.overlap)]
        if self.others:
            notes.append(
                f"Other contacts acted during the impact: {', '.join(sorted(self.others))}."
            )
        return Facts(
            engine="drake",
            version=self._version,
            model=self.loaded.label,
            pair=(place.first.name, place.second.name),
            moved=place.moved,
            timestep=self.timestep,
            gravity=tuple(self.loaded.plant.gravity_field().gravity_vector().tolist()),
            effective_mass=place.effective_mass,
            normal=tuple(place.gap.normal.tolist()),
            settings={
                "plant": f"discrete, {config.discrete_contact_approximation}, {config.contact_model}",
                "point_contact_stiffness of the pair (N/m)": stiffness,
                "hunt_crossley_dissipation of the pair (s/m)": dissipation,
            },
            asked=asked,
            asked_description=words,
            notes=tuple(filter(None, notes)),
            point=tuple(place.gap.point.tolist()),
        )

    def suspects(self, impacts: Sequence[Impact], wanted: RestitutionCurve | None) -> list[Suspect]:
        """Return settings that may keep this pair from bouncing as `wanted`, likeliest first.

        impacts: of the launches.
        wanted: e over speed; None where the user named none. A hydroelastic pair is suspected only
        of gain, few steps and other contacts.
        """
        step = diagnose.StepFix(
            self.timestep, "time_step={} of the plant, or --timestep", _set_step
        )
        found: list[Suspect] = []
        if self._is_point_contact():
            found += self._implicit_step()
            found += self._dissipation(impacts, wanted)
        found += diagnose.energy_gain(impacts, step)
        found += diagnose.few_steps(impacts, step, "a softer contact")
        found += diagnose.other_contacts(sorted(self.others))
        return found

    def _implicit_step(self) -> Iterator[Suspect]:
        """Suspect the time step of a discrete plant, whose implicit integration damps by itself; at
        most one suspect, none where that takes less than _NOTABLE of e.
        """
        stiffness, _ = self.pair_values()
        omega = math.sqrt(stiffness / self.mass)  # 1/s
        # The factor of e.
        kept = math.exp(-0.5 * math.pi * omega * self.timestep)
        if 1.0 - kept < _NOTABLE:
            return
        # At this step, s, exp(-π ω h/2) is about 1 - _TAKEN.
        step = 2.0 * _TAKEN / (math.pi * omega)
        # A step so fine that it takes too long is named, but not tried.
        fix = None
        if step * _FINEST > self.timestep:
            fix = partial(_set_step, timestep=step)
        yield Suspect(
            "implicit-step",
            "A discrete plant damps by its step: e is multiplied by exp(-π ω h/2), ω² = k/m.",
            f"a factor of {kept:.3g} at {self.timestep:g} s and ω = {omega:.4g} 1/s",
            f"time_step={step:.3g}, or a softer point_contact_stiffness, or a continuous plant (time_step=0)",
            fix,
            always_reported=True,
        )

    def _dissipation(
        self, impacts: Sequence[Impact], wanted: RestitutionCurve | None
    ) -> Iterator[Suspect]:
        """Suspect a dissipation with an e other than the target, or that is Drake's default; at
        most one suspect.

        impacts: of the launches, whose median speed counts.
        wanted: e over speed; None where the user named none.
        """
        speed = float(np.median(diagnose.speeds_of(impacts)))
        _, dissipation = self.pair_values()
        # The target's one e over the speeds, None without a target; and that of the model. Drake's
        # dissipation is 1.5 α.
        target_e = diagnose.constant_e(impacts, wanted)
        asked = float(Restitution(dissipation / 1.5).at(speed))
        is_default = not any(
            self.loaded.says(shape, DISSIPATION) for shape in self.place.gap.geometries
        )
        if not is_default and (target_e is None or abs(target_e - asked) < _NOTABLE):
            return
        goal = diagnose.BOUNCY if target_e is None else target_e
        if isinstance(wanted, Restitution):
            alpha = wanted.alpha
        else:
            alpha = float(alpha_of(goal, speed))
        needed = 1.5 * alpha
        key = "dissipation"
        words = "The dissipation gives an e other than the target."
        if is_default:
            key = "default-dissipation"
            words = "With Drake's default dissipation, 50 s/m, almost nothing bounces."
        yield Suspect(
            key,
            words,
            f"hunt_crossley_dissipation {dissipation:.4g} s/m: e = {asked:.3g} at {speed:.3g} m/s",
            f'<drake:{DISSIPATION} value="{needed:.4g}"/> in <drake:proximity_properties> of both',
            partial(_set_dissipation, dissipation=needed),
            always_reported=is_default,
            assumed_e=goal if wanted is None else None,
        )

    def fixed(self, suspects: Sequence[Suspect]) -> DrakeModel:
        """The same pair, loaded again with some fixes made."""
        changes = dict(self._changes)
        for suspect in suspects:
            if suspect.apply is not None:
                suspect.apply(changes)
        return DrakeModel(*self._given, changes)


def _require_normal_launches(request: Request) -> None:
    """Raise UserError for a request that chooses how a pair is launched: at an angle, by which
    joint, or from which side.
    """
    if request.is_oblique:
        slot = "angle"
    elif request.move is not None:
        slot = "move"
    elif request.coming_from is not None:
        slot = "from"
    else:
        return
    raise UserError(
        slot, "given", "none: a pair in Drake is sent along its normal, the nearest way"
    )


def _set_step(changes: MutableMapping[str, Any], timestep: float) -> None:
    changes["timestep"] = min(timestep, changes.get("timestep", math.inf))


def _set_dissipation(changes: MutableMapping[str, Any], dissipation: float) -> None:
    changes["dissipation"] = dissipation


class DrakeSimulation(Simulation):
    """One launch of a placed pair, in a context of its own."""

    def __init__(self, model: DrakeModel, launch: Launch) -> None:
        """Put the pair where the launch begins, at its speed: in contexts of Drake's that are this
        launch's own.

        model: with its pair at touch; it keeps the names of what else touches.
        launch: normal.
        """
        self._model = model
        self._loaded = model.loaded
        self._place = model.place
        self._h = model.timestep
        plant = self._loaded.plant
        diagram = self._loaded.diagram
        self._root = diagram.CreateDefaultContext()
        self._context = plant.GetMyMutableContextFromRoot(self._root)
        self._simulator = self._loaded.drake.Simulator(diagram, self._root)
        plant.SetPositions(self._context, self._place.positions)
        # m, back along the approach.
        back = -launch.clearance_in_phase(self._h, model.gravity)
        move_on(self._loaded, self._context, back * self._place.direction)
        plant.SetVelocities(self._context, launch.speed * self._place.direction)
        self._simulator.Initialize()
        self._steps = 0

    def advance(self, steps: int) -> Record:
        """Take `steps` steps as a user's Simulator does; the record ends earlier, with a step of
        NaN, where Drake gave up.
        """
        rows: list[tuple[float, float, float]] = []
        is_finite = True
        while len(rows) < steps and is_finite:
            penetration, rate, force = self._step()
            rows.append((penetration, rate, force))
            is_finite = math.isfinite(rate)
        return Record(*np.array(rows).T[:, None])

    def keep(self, which: Flags) -> None:
        """Keep the one launch that there is."""

    def _step(self) -> tuple[float, float, float]:
        """Take one step: penetration, m, and its rate, m/s, before it, and the force of the pair in
        it, N; all NaN where Drake gave up.
        """
        plant = self._loaded.plant
        pair = (self._place.first, self._place.second)
        try:
            gap = self._loaded.nearest(self._context, *pair)
            row = approach_row(self._loaded, self._context, pair, gap)
            rate = float(row @ plant.GetVelocities(self._context))
            self._steps += 1
            # To a multiple of the step, not on by one: sums of steps would round off.
            self._simulator.AdvanceTo(self._steps * self._h)
            force = self._force(gap.normal)
        except RuntimeError:
            return math.nan, math.nan, math.nan
        return -gap.distance, rate, force

    def _force(self, normal: Any) -> float:
        """Contact force of the pair in the step just taken, N, above 0 where it parts them.

        normal: from the first to the second. The sampled ports of a discrete plant are of that
        step.
        """
        results = self._loaded.plant.get_contact_results_output_port().Eval(self._context)
        total = 0.0
        for i in range(results.num_point_pair_contacts()):
            info = results.point_pair_contact_info(i)
            point = info.point_pair()
            total += self._of_pair((point.id_B, point.id_A), info.contact_force(), normal)
        # Drake's force of a point contact is on its body B, that of a surface on its M.
        for i in range(results.num_hydroelastic_contacts()):
            surface = results.hydroelastic_contact_info(i)
            ids = surface.contact_surface().id_M(), surface.contact_surface().id_N()
            total += self._of_pair(ids, surface.F_Ac_W().translational(), normal)
        return total

    def _of_pair(self, shapes: tuple[Any, Any], force: Any, normal: Any) -> float:
        """Share of one contact in the force that parts the pair, N: 0 for a contact of others; if one
        of the pair touches another shape, the model under test notes that.

        shapes: ids of the two that touch.
        force: on the first of them, N, (3,).
        normal: unit vector from the pair's first part to the second, (3,).
        """
        first = self._place.first.geometries
        second = self._place.second.geometries
        one, two = shapes
        if one in first and two in second:
            return -float(normal @ force)
        if one in second and two in first:
            return float(normal @ force)
        others = [shape for shape in shapes if shape not in (*first, *second)]
        # One of the pair touches something else.
        if len(others) < len(shapes):
            self._model.others |= {self._loaded.short(shape) for shape in others}
        return 0.0


def list_pairs(drake: Any, source: Any, request: Request) -> list[CandidatePair]:
    """List every pair of shapes that can meet, in each the one that moves first; pairs that touch
    come first.

    drake: the module pydrake.all.
    source: one path or several.
    Raises SceneError for files that do not load, UserError for a pose that does not fit.
    """
    loaded = LoadedPlant(drake, source, request, {})
    root = loaded.diagram.CreateDefaultContext()
    context = loaded.plant.GetMyMutableContextFromRoot(root)
    set_pose(loaded, context, request)
    pairs = []
    for both in loaded.collide:
        first, second = _in_order(loaded, both)
        pairs.append(_described(loaded, context, first, second))
    return in_order(pairs)


def _in_order(loaded: LoadedPlant, both: frozenset[Any]) -> list[Part]:
    """The two of a pair, the one that moves first."""
    shapes = sorted(
        both, key=lambda g: (loaded.plant.IsAnchored(loaded.body_of(g)), loaded.short(g))
    )
    return [Part(loaded.short(shape), loaded.body_of(shape), (shape,)) for shape in shapes]


def _described(loaded: LoadedPlant, context: Any, first: Part, second: Part) -> CandidatePair:
    """Describe a pair of single shapes in a pose: names, effective mass (kg), signed distance (m) and
    contact parameters.

    context: Drake's, of the plant.
    first, second: parts of one geometry each. Mass, kg, and distance, m, are NaN where Drake does
    not know the distance.
    """
    distance = math.nan  # m
    mass = math.nan  # kg
    try:
        gap = loaded.nearest(context, first, second)
    # Drake does not know the distance of these shapes.
    except UserError:
        pass
    else:
        distance = gap.distance
        row = approach_row(loaded, context, (first, second), gap)
        # J M⁻¹ Jᵀ, 1/kg; 0 where neither can move.
        mobility = float(row @ np.linalg.solve(loaded.plant.CalcMassMatrix(context), row))
        if mobility > 0:
            mass = 1.0 / mobility
    first_mover = next(chain(movers(loaded, first.body), movers(loaded, second.body)), None)
    joint = "nothing"
    if first_mover is not None:
        _, joint = first_mover
    (first_shape,) = first.geometries
    (second_shape,) = second.geometries
    settings = {}
    for name in (STIFFNESS, DISSIPATION):
        settings[name] = [loaded.property(first_shape, name), loaded.property(second_shape, name)]
    return CandidatePair(
        bodies=(first.body.name(), second.body.name()),
        geoms=(first.name, second.name),
        types=(_type(loaded, first_shape), _type(loaded, second_shape)),
        pair=joined_names([f"geom:{first.name}", f"geom:{second.name}"]),
        joint=joint,
        effective_mass=mass,
        distance=distance,
        touching=distance <= 0.0,
        settings=settings,
    )


def _type(loaded: LoadedPlant, shape: Any) -> str:
    """The kind of a shape, as Drake calls it."""
    return type(loaded.inspector.GetShape(shape)).__name__
