"""MuJoCo: its own contact, from stock to matched, through the contract.

Options of a setting (all optional; none means as authored):
    integrator: "Euler", "implicit", "implicitfast", "RK4" or "discrete".
    rows: contact constraints that take the place of the model's own, each {"solref": [2 numbers],
        "solimp": [5 numbers], "onset": depth at which it starts, m, "adhesion": force with which it may
        pull, N}. On a plane each is a <pair>, of coincident geoms where there are several; in a cup each
        is a tendon's limit.
    law: a plug-in of hcbench.contact in place of MuJoCo's own contact, as
        `hcbench.laws.contact_law.law_of` reads it: {"kind": "force", "alpha": s/m, "stiffness": N/m^n,
        "exponent": n}, {"kind": "restitution", "alpha": s/m}, or with {"law": a later law's slug,
        "restitution": e} in place of alpha.
"""

from __future__ import annotations

import dataclasses
from contextlib import contextmanager
from functools import lru_cache
from importlib import metadata
from typing import TYPE_CHECKING, ClassVar

from hcbench.engines.mujoco import simulate
from hcbench.engines.mujoco.backend import INSTALL
from hcbench.engines.mujoco.mjcf import model_path
from hcbench.engines.mujoco.options import read_options
from hcbench.engines.mujoco.simulate import Fleet
from hcbench.engines.mujoco.world import load
from hcbench.errors import EngineMissing
from hcbench.impact import Status
from hcbench.sim.engine import Engine

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from hcbench.engines.mujoco.options import Options
    from hcbench.engines.mujoco.world import Loaded
    from hcbench.impact import Impact, Launch, Trajectory
    from hcbench.scene import Scene
    from hcbench.setting import Setting
    from hcbench.tune.recipe import Recipe

_SLOWEST = 1e-3  # m/s: for a body let down on the plate, the step is judged at this speed
_DIVERGED = "MuJoCo gave up: a position, velocity or acceleration was not finite or above 1e10"


class MujocoEngine(Engine):
    """MuJoCo behind its Python bindings, 3.3 and later."""

    name: ClassVar[str] = "mujoco"
    title: ClassVar[str] = "MuJoCo"
    install: ClassVar[str] = INSTALL

    def version(self) -> str:
        """The wheel's version; the module itself is not imported, it is slow."""
        for wheel in ("mujoco", "mujoco-core"):
            try:
                return metadata.version(wheel)
            except metadata.PackageNotFoundError:
                continue
        raise EngineMissing("engine 'mujoco'", "not installed", "its wheel", f"Try: {INSTALL}")

    def recipes(self) -> Sequence[Recipe]:
        """What makes its settings."""
        from hcbench.engines.mujoco.recipes import RECIPES

        return RECIPES

    def fly(self, scene: Scene, setting: Setting, launches: Sequence[Launch]) -> list[Impact]:
        """One impact for each launch, the same bits however many there are."""
        options = read_options(setting.options)
        if options.law is None:
            fleet = _fleet(scene, setting.timestep, options)
            return [_named(impact) for impact in simulate.fly(fleet, launches)]
        fastest = max((launch.speed for launch in launches), default=0.0)
        with self._ready(scene, setting.timestep, options, fastest) as model:
            return [_named(impact) for impact in simulate.fly(Fleet.of(model), launches)]

    def follow(self, scene: Scene, setting: Setting, launch: Launch, duration: float) -> Trajectory:
        """Every step of `duration` s after release; NaN from where MuJoCo gave up."""
        options = read_options(setting.options)
        with self._ready(scene, setting.timestep, options, launch.speed) as model:
            return simulate.follow(model, launch, max(1, round(duration / setting.timestep)))

    @staticmethod
    @contextmanager
    def _ready(scene: Scene, timestep: float, options: Options, speed: float) -> Iterator[Loaded]:
        """The scene under a setting, with its plug-in attached, for impacts at up to `speed` m/s."""
        model = load(scene, timestep, options)
        if options.law is None:
            yield model
            return
        from hcbench.engines.mujoco.plugin import attach as contact

        own = {"tendons": ["contact"]} if scene.form == "cup" else {"pairs": [("ball", "plate")]}
        with contact.attach(model.model, law=options.law, speed=max(speed, _SLOWEST), **own):
            yield model


def _fleet(scene: Scene, timestep: float, options: Options) -> Fleet:
    """A scene under a setting, compiled; kept for who asks for the same again."""
    try:
        written = model_path(scene).read_bytes()
    except OSError:  # which loading it will tell
        written = b""
    # Another file that it names may change while it does not.
    make = _kept if written and b"file=" not in written else _kept.__wrapped__
    return make(scene, timestep, options, written)


@lru_cache(maxsize=4)
def _kept(scene: Scene, timestep: float, options: Options, _: bytes) -> Fleet:
    return Fleet.of(load(scene, timestep, options))


def _named(impact: Impact) -> Impact:
    diverged = impact.status is Status.DIVERGED
    return dataclasses.replace(impact, reason=_DIVERGED) if diverged else impact
