# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""MJX, in 64 bits, many worlds at once: it steps the models that MuJoCo's adapter makes."""

import os
import runpy
from importlib.metadata import version
from pathlib import Path
from typing import Any

# Else its threads may wait for each other without end.
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
import jax
import jax.numpy as jnp
import numpy as np
from mujoco import mjx

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", str(Path.home() / ".cache" / "jax"))
MUJOCO = runpy.run_path(str(Path(__file__).parents[1] / "mujoco" / "cases.py"))
Best: Any = MUJOCO["MujocoBodies"]
Stock: Any = MUJOCO["MujocoStock"]


def _steps(models: Any, now: Any, count: Any) -> Any:
    """Take `count` steps in all worlds."""
    step = jax.vmap(mjx.step)
    return jax.lax.fori_loop(0, count, lambda _, x: step(models, x), now)


class MjxWorlds:
    """Mixin that steps all worlds at once; the class after it, of MuJoCo's adapter, makes them.

    made: MjModel and MjData of each world that is to be started.
    """

    version = version("mujoco-mjx")

    def __init__(self) -> None:
        self.made: list[tuple[Any, Any]] = []
        self.steps = jax.jit(_steps)

    def make(self, world: dict[str, Any]) -> None:
        """Build a model as MuJoCo's adapter does, and keep it for a step of all worlds at once.

        world: in SI units: timestep, gravity, friction, restitution, bodies, and floor, true or
        false.
        Raises NotImplementedError for `materials`, restitutions of a material each, and in the
        stock setting for an e above 0.
        """
        super().make(world)  # type: ignore[misc]
        # MJX has no elliptic cone without friction.
        self.model.opt.cone *= bool(world["friction"])
        if not world["restitution"]:
            # With MuJoCo's 1e6 a box does not rest.
            self.model.opt.impratio = min(self.model.opt.impratio, 100.0)
        self.made.append((self.model, self.data))

    def start(self) -> None:
        """Start all worlds that were added since the last start, as one batch.

        Their models have the same shapes and steps of one length.
        """
        self.worlds = self.made
        self.made = []
        # Steps still to be taken.
        self.ahead = 0
        models = [mjx.put_model(model) for model, _ in self.worlds]
        # One model whose arrays have those of all worlds, in their first axis; and such data.
        leaves = zip(*map(jax.tree.leaves, models), strict=True)
        self.models = jax.tree.structure(models[0]).unflatten(jnp.stack(each) for each in leaves)
        empty = jax.tree.map(lambda x: jnp.stack([x] * len(models)), mjx.make_data(models[0]))
        q = np.array([data.qpos for _, data in self.worlds])
        v = np.array([data.qvel for _, data in self.worlds])
        self.now = empty.replace(qpos=empty.qpos.at[:].set(q), qvel=empty.qvel.at[:].set(v))

    def step(self) -> None:
        # They are taken all at once, when a state is asked for.
        self.ahead += 1

    def state(self) -> list[Any]:
        self.now = self.steps(self.models, self.now, self.ahead)
        self.ahead = 0
        return [
            self._state(*each)
            for each in zip(self.worlds, self.now.qpos, self.now.qvel, strict=True)
        ]

    def _state(self, world: tuple[Any, Any], q: Any, v: Any) -> Any:
        self.model, self.data = world
        self.data.qpos[:], self.data.qvel[:] = q, v
        return super().state()  # type: ignore[misc]


class MjxBodies(MjxWorlds, Best):  # type: ignore[misc]
    """An engine of `hcbench_cases`: MJX with the best settings that are known."""

    name = "mjx"


class MjxStock(MjxWorlds, Stock):  # type: ignore[misc]
    """An engine of `hcbench_cases`: MJX with nothing chosen but the friction."""

    name = "mjx-stock"


ENGINES = [MjxBodies, MjxStock]
