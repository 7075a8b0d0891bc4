"""Restitution by impact speed in MuJoCo Warp: a step of all worlds, in place of `mujoco_warp.step`.

    import mujoco_warp as mjw
    from hcbench.contact.warp import restitution

    step = restitution(model, {("ball", "floor"): 0.3})  # α, s/m
    m, d = mjw.put_model(model), mjw.make_data(model, nworld=4096)
    step(m, d)

Contacts that touch and approach faster than their load moves them in a step collide at the start of
the step, all at once, with Coulomb friction, each with the e of its own approach. Contacts that part
then are silent for the step; those that rest stay MuJoCo Warp's own. All of it is done by kernels on
the device. The rules are those of the step in MJX, `hcbench.contact.mjx`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from hcbench.engines.mujoco_warp.engine import MujocoWarpEngine
from hcbench.sim.pair_laws import Pairs, laws_of
from hcbench.sim.warp_contact import WarpImpacts
from hcbench.terms.arguments import checked

Step = Callable[..., None]


@checked
def restitution(model: Any, pairs: Pairs) -> Step:
    """Return `step(m, d)`, as `mujoco_warp.step`, in which these pairs bounce by their law.

    Parameters
    ----------
    model : mujoco.MjModel
        The model that `mujoco_warp.put_model` got. Its integrator is Euler or implicitfast.
    pairs : mapping
        By two names of geoms, or of bodies, which stand for all their geoms ("world" for what is
        fixed): α in s/m, a `Restitution`, or a `ConstantRestitution`.

    Returns
    -------
    callable
        `step(m, d, values=None)` for MuJoCo Warp's `Model` and `Data`. values: a Warp array of
        float32 on their device, (worlds, pairs) or (1, pairs): α (s/m) or e of each pair in the
        order of `pairs`; those of `pairs` unless given. After one step it can be captured as a
        graph; keep the function as long as the graph.

    Raises
    ------
    EngineMissing
        Without MuJoCo Warp.
    UserError
        For another model, names that it lacks, and pairs given twice.
    SettingError
        For an option that no step of this kind has been tried with.

    """
    impacts = WarpImpacts(laws_of(model, pairs))
    mujoco_warp = MujocoWarpEngine.backend.module("mujoco_warp")

    def step(m: Any, d: Any, values: Any = None) -> None:
        """Take one step of all worlds. m, d: MuJoCo Warp's. values: of each pair's law.

        Raises UserError for values of another shape, and for another model; SettingError for
        options of `m` that no step of this kind has been tried with.
        """
        impacts.step(partial(mujoco_warp.step, m, d), m, d, values)

    return step
