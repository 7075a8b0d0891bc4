"""Restitution by impact speed in Newton's SolverMuJoCo: a step of it, in place of `solver.step`.

    import newton
    from hcbench.contact.newton import restitution

    solver = newton.solvers.SolverMuJoCo(model)
    step = restitution(solver, {("ball", "floor"): 0.3})  # α, s/m
    step(state, after, control, None, dt)

This solver steps MuJoCo Warp: the impacts are those of `hcbench.contact.warp`, by kernels on the
device. Other solvers of Newton have no such step; SolverXPBD takes one e of each shape.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hcbench.sim.pair_laws import Names, Pairs, laws_of
from hcbench.sim.warp_contact import WarpImpacts
from hcbench.system.errors import SettingError, UserError
from hcbench.terms.arguments import checked

Step = Callable[..., None]


@checked
def restitution(solver: Any, pairs: Pairs) -> Step:
    """Return `step(...)`, as `solver.step(...)`, in which these pairs bounce by their law.

    Parameters
    ----------
    solver : newton.solvers.SolverMuJoCo
        One that steps MuJoCo Warp with the contacts that it finds itself: with `use_mujoco_cpu`
        and `use_mujoco_contacts` as they are by default.
    pairs : mapping
        By two labels of shapes, or of bodies, which stand for all their shapes ("world" for what
        is fixed): α in s/m, a `Restitution`, or a `ConstantRestitution`. Of a label with slashes
        the last part is enough.

    Returns
    -------
    callable
        `step(state_in, state_out, control, contacts, dt, values=None)`. values: a Warp array of
        float32 on the solver's device, (worlds, pairs) or (1, pairs): α (s/m) or e of each pair in
        the order of `pairs`; those of `pairs` unless given.

    Raises
    ------
    UserError
        For another solver, labels that its model lacks, and pairs given twice.
    SettingError
        For an option that no step of this kind has been tried with.

    """
    if type(solver).__name__ != "SolverMuJoCo":
        expected = "newton.solvers.SolverMuJoCo"
        raise UserError("solver", f"a {type(solver).__name__}", expected)
    if solver.use_mujoco_cpu:
        raise SettingError("use_mujoco_cpu", "True", "False: contacts on the device")
    if not solver.mjw_model.opt.run_collision_detection:
        raise SettingError("use_mujoco_contacts", "False", "True: contacts that the solver finds")
    impacts = WarpImpacts(laws_of(solver.mj_model, pairs, _names(solver)))

    def step(*arguments: Any, values: Any = None, **keywords: Any) -> None:
        """Take one step. values: of each pair's law; other arguments: those of `solver.step`.

        Raises UserError for values of another shape.
        """
        # Within its step the solver calls this method for MuJoCo Warp's: for one step the object
        # gets one of its own, which goes before that of its class.
        own = solver._mujoco_warp_step
        solver._mujoco_warp_step = lambda: impacts.step(
            own, solver.mjw_model, solver.mjw_data, values
        )
        try:
            solver.step(*arguments, **keywords)
        finally:
            # The method of its class is found again.
            del solver._mujoco_warp_step

    return step


def _names(solver: Any) -> Names:
    """Numbers of MuJoCo's geoms, (n,), by the names that users may write: labels of shapes and of
    bodies, the last part of each after its slashes, and "world" for what is fixed.

    solver: Newton's SolverMuJoCo.
    """
    model = solver.model
    # Newton's shape of each of MuJoCo's geoms, of the first world: all are alike.
    shapes = solver.mjc_geom_to_newton_shape.numpy()[0]
    bodies = model.shape_body.numpy()
    names: dict[str, list[int]] = {"world": []}
    for geom, shape in enumerate(shapes):
        # Newton's body of what is fixed is -1.
        body = bodies[shape]
        owner = "world" if body < 0 else model.body_label[body]
        label = model.shape_label[shape]
        known_as = (owner, owner.rpartition("/")[2], label, label.rpartition("/")[2])
        # Each name once: many have no slashes.
        for name in dict.fromkeys(known_as):
            names.setdefault(name, []).append(geom)
    return {name: np.array(geoms) for name, geoms in names.items()}
