"""Newton behind the contract of an engine: a ball on its ground plane, in many worlds at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from hcbench._text import shortest
from hcbench.errors import SettingError
from hcbench.fields import Finite
from hcbench.laws.force import HuntCrossley
from hcbench.laws.restitution import Restitution
from hcbench.sim.backend import Backend
from hcbench.sim.batched import ScriptedWorlds, require_motion
from hcbench.sim.read_impact import SpeedReading
from hcbench.sim.scripted import ScriptedEngine, ScriptOptions

if TYPE_CHECKING:
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.sim.engine import World


class NewtonOptions(ScriptOptions):
    """A setting's options: none of them means SolverXPBD as it comes, which ignores restitutions.

    restitution: of both shapes, for XPBD. ke (N/m), kd (N s/m): of both, SemiImplicit's.
    """

    solver: Literal["XPBD", "SemiImplicit"] = "XPBD"
    restitution: Annotated[Finite | None, Field(ge=0.0, le=1.0)] = None
    ke: Annotated[Finite | None, Field(gt=0.0)] = None
    kd: Annotated[Finite | None, Field(ge=0.0)] = None


class NewtonEngine(ScriptedEngine[NewtonOptions]):
    """Newton 1.8."""

    name: ClassVar[str] = "newton"
    title: ClassVar[str] = "Newton"
    backend: ClassVar[Backend] = Backend("newton", "newton", "1.8", "1.8")
    bits: ClassVar[int] = 32
    own_process: ClassVar[bool] = True
    limit: ClassVar[float] = 600.0  # Warp compiles its kernels when first used
    together: ClassVar[int] = 64  # a step of one world costs as much as of all
    table = NewtonOptions

    def lines(self, options: NewtonOptions, scene: Scene) -> str:
        """Shapes, worlds, solver, and what it does before a step."""
        if isinstance(options.law, Restitution) and options.solver != "XPBD":
            raise SettingError("newton option 'solver'", "'SemiImplicit' with an e", "'XPBD', which has one")
        shape, solver, hook = _parts(options)
        force = isinstance(options.law, HuntCrossley)
        return _LINES.format(
            shape=shape,
            solver=solver,
            hook=hook,
            call="\n    before_step()" if hook else "",
            collide="" if force else "\n    collisions.collide(now, contacts)",
            contacts="None" if force else "contacts",
        )

    def paste(self, options: NewtonOptions, timestep: str) -> str:
        """Shapes, solver, and what it does before a step."""
        return "\n".join(filter(None, _parts(options)))

    def reading(self, options: NewtonOptions) -> SpeedReading:
        """XPBD turns around v + g h."""
        smooth = options.solver == "SemiImplicit" or isinstance(options.law, HuntCrossley)
        return SpeedReading.TOUCH_PLANE if smooth else SpeedReading.STEP_END

    def load(self, scene: Scene, setting: Setting, fastest: float) -> World:  # type: ignore[override]
        """The worlds of the script. Raises SettingError for a step too short for float32."""
        require_motion(scene, setting.timestep, fastest, self.bits)
        script = self.script(scene, setting).replace("worlds = 1", f"worlds = {self.together}")
        return ScriptedWorlds(
            scene, setting.timestep, self.together, script, self.reading(self.read(setting))
        )


def _parts(options: NewtonOptions) -> tuple[str, str, str]:
    """Shapes, solver, and the law's function."""
    given = options.model_dump(include={"restitution", "ke", "kd"}, exclude_none=True)
    shape = ", ".join(["mu=0.0", "density=0.0", *(f"{k}={shortest(v)}" for k, v in given.items())])
    bounces = options.restitution is not None or isinstance(options.law, Restitution)
    more = ", enable_restitution=True" if bounces else ""
    hook = "" if options.law is None else _FORCE if isinstance(options.law, HuntCrossley) else _EACH
    return (
        f"shape = newton.ModelBuilder.ShapeConfig({shape})  # of both",
        f"solver = newton.solvers.Solver{'SemiImplicit' if hook == _FORCE else options.solver}(model{more})",
        hook,
    )


_LINES = """\
import numpy as np
import warp as wp
wp.config.quiet = True
import newton
worlds = 1
{shape}
ball, scene = (newton.ModelBuilder(gravity=(0.0, 0.0, -gravity)) for _ in range(2))
turning = wp.mat33(inertia, 0, 0, 0, inertia, 0, 0, 0, inertia)
body = ball.add_body(xform=wp.transform((0.0, 0.0, R), wp.quat_identity()), mass=m, inertia=turning)
ball.add_shape_sphere(body, radius=R, cfg=shape)
scene.add_ground_plane(cfg=shape)
scene.replicate(ball, worlds)
model = scene.finalize()
{solver}
collisions = newton.CollisionPipeline(model)
contacts, control = collisions.contacts(), model.control()
def place(height, velocity):
    global now, after
    now, after = model.state(), model.state()
    q, qd = now.body_q.numpy(), now.body_qd.numpy()
    q[:, 2], qd[:, 2] = height, velocity  # of qd the first three are linear
    now.body_q.assign(q)
    now.body_qd.assign(qd)
    return state()
def state():
    z, v = now.body_q.numpy()[:, 2].astype(float), now.body_qd.numpy()[:, 2].astype(float)
    return (z[0], v[0]) if worlds == 1 else (z, v)
{hook}
def step():
    global now, after
    now.clear_forces(){call}{collide}
    solver.step(now, after, control, {contacts}, timestep)
    now, after = after, now
    return state()"""
_FORCE = """
def before_step():  # after clear_forces(); contacts are left out of the step
    z, v = np.atleast_1d(*state())
    force = now.body_f.numpy()
    force[:, 2] = [law(R - height, -velocity) for height, velocity in zip(z, v)]
    now.body_f.assign(force)
"""
_EACH = """
balls = model.shape_body.numpy() >= 0
def before_step():  # the shapes' restitutions are averaged: the plane has none
    speed = gravity * timestep - now.body_qd.numpy()[:, 2]  # what XPBD turns around
    restitution = np.zeros(len(balls), np.float32)
    restitution[balls] = 2 * np.clip(curve.at(np.maximum(speed, 0)), 0, 1)
    model.shape_material_restitution.assign(restitution)
"""
