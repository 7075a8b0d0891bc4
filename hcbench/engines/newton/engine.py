"""Newton behind the contract of an engine: a ball on its ground plane, in many worlds at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Field

from hcbench.laws import kelvin_voigt as kv
from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact, Feature, Features
from hcbench.sim.scripted import ScriptedWorldsEngine, ScriptOptions
from hcbench.system.errors import SettingError
from hcbench.system.text import arguments, shortest
from hcbench.terms.fields import Finite, OptionTable
from hcbench.terms.scene import Scene


class PushingRow(OptionTable):
    """A contact of SolverMuJoCo, as MuJoCo's settings have them."""

    solref: tuple[Finite, Finite]
    solimp: tuple[Finite, Finite, Finite, Finite, Annotated[Finite, Field(le=100.0)]] = Field(
        description="5 numbers, the power 100 at most: higher ones underflow in float32"
    )
    onset: Finite = 0.0
    adhesion: Literal[0] = Field(
        0, description="0 N: Newton's pairs cannot pull; `staggered-push` does not"
    )


class NewtonOptions(ScriptOptions):
    """A setting's options: none of them means SolverXPBD with nothing set.

    restitution: of both shapes, for XPBD. ke (N/m), kd (N s/m): of both, SemiImplicit's; MuJoCo
    makes a solref of them, per unit mass.
    rows: MuJoCo's contacts, in place of that of the shapes.
    """

    solver: Literal["XPBD", "SemiImplicit", "MuJoCo"] | None = None
    restitution: Annotated[Finite | None, Field(ge=0.0, le=1.0)] = None
    ke: Annotated[Finite | None, Field(gt=0.0)] = None
    kd: Annotated[Finite | None, Field(ge=0.0)] = None
    rows: tuple[PushingRow, ...] = ()


class NewtonEngine(DescribesContact, ScriptedWorldsEngine[NewtonOptions]):
    """The engine Newton 1.8."""

    name = "newton"
    title = "Newton"
    backend = Backend("newton", "newton", "1.8", "1.8", "pip install 'newton[sim]'")
    table = NewtonOptions
    features = Features(
        law=Feature(
            "XPBD: an e in one step; SemiImplicit: ke x + kd v in, ke x out; MuJoCo's", "measured"
        ),
        exponent=Feature("XPBD none: rigid; SemiImplicit 1; MuJoCo's solver as MuJoCo", "measured"),
        threshold=Feature("2 g h by XPBD under gravity", "measured"),
        licence=Feature("Apache-2.0", "its wheel"),
        energy=Feature(
            "XPBD gains none: an e of 1.48, read earlier, was the reading", "measured by heights"
        ),
    )

    def lines(self, options: NewtonOptions, scene: Scene) -> str:
        """Lines of Python that build a model of many worlds with the contact or the law of a setting,
        choose a solver, and define its step.

        options: the setting's.
        scene: not used: its numbers are names that the lines find.
        Raises SettingError for an e without XPBD, and for a law or rows without SolverMuJoCo.
        """
        # Name of the solver, keywords of both shapes, lines of contact pairs.
        solver, values, contact = _parts(options)
        is_mujoco = solver == "MuJoCo"
        by_force = isinstance(options.law, HuntCrossley)
        # The mass is that of the body.
        shape = {"mu": 0.0, "density": 0.0, **values}
        # Bodies have their state as such, or as joints; and some solvers find contacts themselves.
        kind = "body"
        contacts = "collisions.contacts()"
        reset = ""
        if is_mujoco:
            # With a mu of 0 the states of SolverMuJoCo are NaN.
            del shape["mu"]
            kind = "joint"
            contacts = "None"
            reset = "\n    solver.reset(now)  # else it starts from the last accelerations"
        step = "solver.step"
        if isinstance(options.law, Restitution):
            step = 'restitution(solver, {("ball", "plate"): curve})'
        hook = ""
        call = ""
        # The law's force takes the place of contacts.
        if by_force:
            contacts = "None"
            hook = _FORCE
            call = "\n    before_step()"
        return _LINES.format(
            shape=_SHAPE.format(arguments(shape)),
            contact=contact or _SHAPES,
            solver=_solver(solver, values),
            take_step=step,
            contacts=contacts,
            kind=kind,
            reset=reset,
            hook=hook,
            call=call,
        )

    def paste(self, options: NewtonOptions, timestep: str) -> str:
        """Shapes, solver, and what it does before a step, or in place of one."""
        if isinstance(options.law, Restitution):
            return _EACH.format(shortest(options.law.alpha), options.law.reading)
        solver, values, contact = _parts(options)
        shape = _SHAPE.format(arguments(values)) + "  # of both" if values else ""
        hook = _FORCE if options.law else ""
        return "\n".join(filter(None, (shape, contact, _solver(solver, values), hook)))

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """One contact in Newton's parameters: its restitution, and with a contact time ke and kd;
        caveats alone for a contact without an e.
        """
        caveats = ("Newton's SolverXPBD needs enable_restitution, and averages both e.",)
        e = contact.restitution
        if e is None:
            return Vocabulary(caveats=caveats)
        note = f"{contact.at}; on both shapes, with enable_restitution"
        values = [SystemValue("Newton", "restitution", (e,), "", note)]
        if contact.contact_time is not None:
            # Of unit mass: SolverMuJoCo's numbers are per mass.
            law = kv.matched(e, contact.contact_time, 1.0, kv.Ending.FORCE)
            numbers = (law.stiffness, law.damping)
            note = "SolverMuJoCo, for every mass; SolverSemiImplicit reads N/m and N s/m"
            values.append(SystemValue("Newton", "ke, kd", numbers, "1/s², 1/s", note))
        return Vocabulary(tuple(values), caveats=caveats)


def _parts(options: NewtonOptions) -> tuple[str, dict[str, float], str]:
    """(name of the solver, keywords that the setting gives both shapes, lines of contact pairs, "" for
    none).

    Raises SettingError for an e without XPBD, and for a law or rows without SolverMuJoCo.
    """
    solver = options.solver or "XPBD"
    # A law chooses the solver: a force pushes the bodies of SemiImplicit, without contacts.
    if isinstance(options.law, HuntCrossley):
        solver = "SemiImplicit"
    if isinstance(options.law, Restitution):
        _require_solver(options.solver or "MuJoCo", "MuJoCo", "a law", True)
        solver = "MuJoCo"
    _require_solver(solver, "XPBD", "an e", options.restitution is not None)
    _require_solver(solver, "MuJoCo", "rows", bool(options.rows))

    values = options.model_dump(include={"restitution", "ke", "kd"}, exclude_none=True)
    lines = []
    for row in options.rows:
        numbers = map(shortest, (*row.solref, *row.solimp, row.onset))
        lines.append(f"\n    ({', '.join(numbers)}),")
    return solver, values, _PAIRS.format("".join(lines)) if lines else ""


def _solver(name: str, values: Mapping[str, float]) -> str:
    """The line that makes a solver, for shapes with these values."""
    more = ", enable_restitution=True" if "restitution" in values else ""
    return f"solver = newton.solvers.Solver{name}(model{more})"


def _require_solver(solver: str, only: str, what: str, is_given: bool) -> None:
    """Raise SettingError where a setting has what `only` one other solver takes."""
    if is_given and solver != only:
        raise SettingError("newton option 'solver'", f"{solver!r} with {what}", f"{only!r}")


_LINES = """\
import numpy as np
import warp as wp
wp.config.quiet = True
import newton
from hcbench.contact.newton import restitution
worlds = 1
{shape}
ball, scene = (newton.ModelBuilder(gravity=(0.0, 0.0, -gravity)) for _ in range(2))
turning = wp.mat33(inertia, 0, 0, 0, inertia, 0, 0, 0, inertia)
body = ball.add_body(xform=wp.transform((0.0, 0.0, R), wp.quat_identity()), mass=m, inertia=turning)
{contact}
scene.replicate(ball, worlds)
model = scene.finalize()
{solver}
take_step = {take_step}
collisions = newton.CollisionPipeline(model)
contacts, control = {contacts}, model.control()  # None: not by these contacts
def place(height, velocity):
    global now, after
    now, after = model.state(), model.state(){reset}
    q, qd = now.{kind}_q.numpy(), now.{kind}_qd.numpy()
    q.reshape(-1, 7)[:, 2], qd.reshape(-1, 6)[:, 2] = height, velocity  # of qd the first three are linear
    now.{kind}_q.assign(q)
    now.{kind}_qd.assign(qd)
    return state()
def state():
    q, qd = now.{kind}_q.numpy().reshape(-1, 7), now.{kind}_qd.numpy().reshape(-1, 6)
    z, v = q[:, 2].astype(float), qd[:, 2].astype(float)
    return (z[0], v[0]) if worlds == 1 else (z, v)
{hook}
def step():
    global now, after
    now.clear_forces(){call}
    if contacts is not None:
        collisions.collide(now, contacts)
    take_step(now, after, control, contacts, timestep)
    now, after = after, now
    return state()"""
_SHAPES = """\
ball.add_shape_sphere(body, radius=R, cfg=shape, label="ball")
scene.add_ground_plane(cfg=shape, label="plate")"""
_SHAPE = "shape = newton.ModelBuilder.ShapeConfig({})"
_PAIRS = """\
plane = ball.add_ground_plane(cfg=shape)  # in each world, as a pair's shapes are of one
for row in (  # solref, solimp, depth from which it acts; a sphere each: of pairs of the same two one acts{}
):
    sphere = ball.add_shape_sphere(body, radius=R, cfg=shape)
    values = dict(condim=1, solref=row[:2], solimp=row[2:7], margin=-row[7])
    newton.solvers.mujoco.add_contact_pair(ball, sphere, plane, **values)"""
_FORCE = """
def before_step():  # after clear_forces(); contacts are left out of the step
    z, v = np.atleast_1d(*state())
    force = now.body_f.numpy()
    force[:, 2] = [law(R - height, -velocity) for height, velocity in zip(z, v)]
    now.body_f.assign(force)
"""
_EACH = """\
from hcbench.contact.newton import Restitution, restitution

solver = newton.solvers.SolverMuJoCo(model)
step = restitution(solver, {{("ball", "plate"): Restitution({}, "{}")}})  # labels of your shapes
# then, in place of solver.step: step(state_in, state_out, control, None, timestep)"""
