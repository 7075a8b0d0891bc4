# SPDX-FileCopyrightText: Copyright (c) 2026 the hcbench authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo Warp, many worlds at once: it steps the models that MuJoCo's adapter makes."""

import runpy
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path
from typing import Any

import mujoco_warp
import numpy as np
import warp

MUJOCO = runpy.run_path(str(Path(__file__).parents[1] / "mujoco" / "cases.py"))
Best: Any = MUJOCO["MujocoBodies"]
Stock: Any = MUJOCO["MujocoStock"]


class WarpWorlds:
    """Mixin that steps all worlds at once; the class after it, of MuJoCo's adapter, makes them.

    made: MjModel and MjData of each world that is to be started.
    worlds: those that are under way.
    all, now: MuJoCo Warp's Model and Data of all of them.
    captured: the graph of one step.
    """

    version = version("mujoco-warp")

    def __init__(self) -> None:
        self.made: list[tuple[Any, Any]] = []

    def make(self, world: dict[str, Any]) -> None:
        super().make(world)  # type: ignore[misc]
        if not world["restitution"]:
            # With MuJoCo's 1e6 a box does not rest.
            self.model.opt.impratio = min(self.model.opt.impratio, 100.0)
        self.made.append((self.model, self.data))

    def start(self) -> None:
        """Start all worlds added since the last start, with one step captured as a graph.

        Their models have the same shapes and steps of one length.
        """
        self.worlds = self.made
        self.made = []
        models = [mujoco_warp.put_model(model) for model, _ in self.worlds]
        self._join(models)
        self._join([model.opt for model in models])
        self.now = mujoco_warp.put_data(*self.worlds[0], nworld=len(models), nconmax=16, njmax=64)
        self.now.qpos.assign(np.array([data.qpos for _, data in self.worlds]))
        self.now.qvel.assign(np.array([data.qvel for _, data in self.worlds]))
        self.all = models[0]
        with warp.ScopedCapture() as self.captured:
            mujoco_warp.step(self.all, self.now)

    @staticmethod
    def _join(parts: list[Any]) -> None:
        """Give the first part the arrays of all, where they differ: one world each."""
        for name in (field.name for field in fields(parts[0])):
            first = getattr(parts[0], name)
            if isinstance(first, warp.array) and first.size and first.shape[0] == 1:
                each = [getattr(part, name).numpy()[0] for part in parts]
                if not all(np.array_equal(each[0], other) for other in each):
                    setattr(parts[0], name, warp.array(np.array(each), dtype=first.dtype))

    def step(self) -> None:
        warp.capture_launch(self.captured.graph)

    def state(self) -> list[Any]:
        q, v = self.now.qpos.numpy(), self.now.qvel.numpy()
        return [self._state(*each) for each in zip(self.worlds, q, v, strict=True)]

    def _state(self, world: tuple[Any, Any], q: Any, v: Any) -> Any:
        self.model, self.data = world
        self.data.qpos[:], self.data.qvel[:] = q, v
        return super().state()  # type: ignore[misc]


class WarpBodies(WarpWorlds, Best):  # type: ignore[misc]
    """An engine of `hcbench_cases`: MuJoCo Warp with the best settings that are known."""

    name = "mujoco-warp"


class WarpStock(WarpWorlds, Stock):  # type: ignore[misc]
    """An engine of `hcbench_cases`: MuJoCo Warp with nothing chosen but the friction."""

    name = "mujoco-warp-stock"


ENGINES = [WarpBodies, WarpStock]
