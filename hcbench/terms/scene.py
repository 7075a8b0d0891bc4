"""A scene: what is dropped on what. Reads the folders under scenes/."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, StrictInt, field_validator

from hcbench.system.errors import QuantityError, SceneError
from hcbench.system.files import is_file
from hcbench.system.text import sanitized
from hcbench.terms import units
from hcbench.terms.arguments import checked, checked_fields
from hcbench.terms.fields import (
    Acceleration,
    Exponent,
    FileTable,
    Friction,
    Length,
    Mass,
    Number,
    Pressure,
    read_toml,
    validate,
)

FILE = "scene.toml"
_PACKAGE = Path(__file__).parents[1]
# Scenes lie beside the package in a checkout, and inside it in a wheel.
_BUILT_IN = (_PACKAGE.parent / "scenes", _PACKAGE / "data" / "scenes")


def _require(slot: str, good: bool, got: str, expected: str, advice: str = "") -> None:
    if not good:
        raise SceneError(slot, got, expected, advice)


@checked_fields
@dataclass(frozen=True, slots=True)
class Material:
    """Elastic constants of a body: young_modulus Pa, poisson_ratio 1."""

    young_modulus: float
    poisson_ratio: float

    def __post_init__(self) -> None:
        """Raise SceneError for numbers that no body has."""
        E = self.young_modulus
        nu = self.poisson_ratio
        _require("young_modulus", 0 < E < math.inf, f"{E!r} Pa", "above 0 Pa")
        _require("poisson_ratio", -1 < nu < 0.5, f"{nu!r}", "within -1 ... 0.5, both excluded")


@checked_fields
@dataclass(frozen=True)
class Scene:
    """The truth about a drop, SI, and the engine files that say the same.

    name: of its folder.
    title: for people.
    form: "cup", the true concave plate; "plane", the equivalent sphere 1/(1/R1 + 1/R2) on a plane.
    mass: of the ball, kg; the plate does not move.
    ball_radius: R1, m.
    plate_radius: R2, m, negative when concave, inf when flat.
    stiffness: k, N/m^exponent.
    gravity: m/s^2 towards the plate, 0 for launches in free flight.
    off_axis: how far from a cup's axis the ball's centre is when it touches, m; it is launched
    along the normal there.
    friction: Coulomb's μ between the two.
    models: engine name -> role -> file, as the engine loads it.

    Raises SceneError for values that no such scene has.
    """

    name: str
    title: str
    form: Literal["cup", "plane"]
    mass: float
    ball_radius: float
    plate_radius: float
    ball_material: Material
    plate_material: Material
    stiffness: float
    exponent: float = 1.5
    gravity: float = 0.0
    off_axis: float = 0.0
    models: Mapping[str, Mapping[str, Path]] = field(default_factory=dict, hash=False)
    friction: float = 0.0

    def __post_init__(self) -> None:
        """Raise SceneError for the first value that no scene has, by its name in a scene.toml."""
        R1 = self.ball_radius
        R2 = self.plate_radius
        _require("ball.mass", 0 < self.mass < math.inf, f"{self.mass!r} kg", "above 0 kg")
        _require("ball.radius", 0 < R1 < math.inf, f"{R1!r} m", "above 0 m")
        _require(
            "plate.radius", R2 != 0 and not math.isnan(R2), f"{R2!r} m", "a radius other than 0 m"
        )
        _require(
            "plate.radius",
            1 / R1 + 1 / R2 > 0,
            f"{R2!r} m under a ball of {R1!r} m",
            "1/R1 + 1/R2 above 0, a bowl wider than the ball",
            "A concave plate has a negative radius, a flat one inf",
        )
        _require("form", self.form in ("cup", "plane"), f"{self.form!r}", "'cup' or 'plane'")
        _require(
            "plate.radius",
            self.form == "plane" or R2 < 0,
            f"{R2!r} m in a cup",
            "a negative radius",
            "Or take form = 'plane'",
        )
        k = self.stiffness
        n = self.exponent
        g = self.gravity
        _require("law.stiffness", 0 < k < math.inf, f"{k!r} N/m^{n:g}", "above 0")
        _require("law.exponent", 1 <= n < math.inf, f"{n!r}", "1 or more")
        _require("gravity", 0 <= g < math.inf, f"{g!r} m/s^2", "0 m/s^2 or more, towards the plate")
        _require("friction", 0 <= self.friction < math.inf, f"{self.friction!r}", "0 or more")
        off = self.off_axis
        # Distance from the axis that the ball's centre can have, m.
        room = 0.0
        allowed = "0 m: a plane has no axis"
        if self.form == "cup":
            room = -R2 - R1
            allowed = f"0 m, or less than |R2| - R1 = {room!r} m"
        _require(
            "off_axis",
            off == 0 or 0 < off < room,
            f"{off!r} m in the form {self.form!r}",
            allowed,
        )

    @property
    def touch_radius(self) -> float:
        """Radius of the sphere that stands for the ball in the scene's form, m."""
        return self.ball_radius if self.form == "cup" else self.relative_radius

    @property
    def inertia(self) -> float:
        """Moment of inertia of the solid ball, kg m²; of its own
        radius, not the equivalent sphere's.
        """
        return 0.4 * self.mass * self.ball_radius**2

    @property
    def tilt(self) -> float:
        """Angle between the axis and the normal at the touch, rad, in the plane of x and z."""
        if self.off_axis == 0.0:
            return 0.0
        room = -self.plate_radius - self.ball_radius
        return math.asin(self.off_axis / room)

    @property
    def normal(self) -> tuple[float, float, float]:
        """The unit vector away from the plate at the touch."""
        return -math.sin(self.tilt), 0.0, math.cos(self.tilt)

    @property
    def touch_offset(self) -> tuple[float, float, float]:
        """Way of the ball's centre, (x, y, z) in m, from where it is in a touch on the axis to
        where it is in this scene's touch.
        """
        lift = 0.0
        if self.off_axis:
            # The centre is on a circle of this radius about that of the plate.
            room = -self.plate_radius - self.ball_radius
            lift = room * (1.0 - math.cos(self.tilt))
        return self.off_axis, 0.0, lift

    @property
    def normal_gravity(self) -> float:
        """Component of gravity along the normal at the touch, m/s^2, positive into the plate."""
        return self.gravity * math.cos(self.tilt)

    @property
    def relative_radius(self) -> float:
        """R = 1/(1/R1 + 1/R2), m: the sphere that meets a plane as this pair meets."""
        # A flat plate has an infinite radius: 1/inf is 0.
        return 1.0 / (1.0 / self.ball_radius + 1.0 / self.plate_radius)


class _Body(FileTable):
    radius: Length
    young_modulus: Pressure
    poisson_ratio: Number

    @field_validator("radius", mode="wrap")
    @classmethod
    def _flat_or_round(cls, value: Any, read: Callable[[Any], float]) -> float:
        return math.inf if value == math.inf else read(value)

    def material(self, slot: str) -> Material:
        try:
            return Material(self.young_modulus, self.poisson_ratio)
        except SceneError as error:
            raise SceneError(f"{slot}.{error.slot}", error.got, error.expected) from None


class _Ball(_Body):
    mass: Mass


class _Law(FileTable):
    stiffness: Any = Field(description="k in N/m^exponent, or text like '3.1e7 lbf/in^1.5'")
    exponent: Exponent = 1.5


class _File(FileTable):
    """A scene.toml: its tables and keys."""

    schema_: StrictInt = Field(
        alias="schema", ge=1, le=1, description="1, the version that this hcbench reads"
    )
    title: str = Field(default="", description="text")
    form: Literal["cup", "plane"] = Field(description="'cup' or 'plane'")
    gravity: Acceleration = 0.0
    friction: Friction = 0.0
    ball: _Ball = Field(description="a [ball] table")
    plate: _Body = Field(description="a [plate] table")
    law: _Law = Field(description="a [law] table")
    models: dict[str, dict[str, str]] = Field(
        default={}, description="[models.ENGINE] tables of file names"
    )


def scene_names() -> list[str]:
    """The built-in scenes, sorted."""
    names: set[str] = set()
    for folder in _BUILT_IN:
        names |= {file.parent.name for file in folder.glob(f"*/{FILE}")}
    return sorted(names)


def built_in_folder(name: str) -> Path:
    """The folder of that name among the built-in scenes."""
    paths = [folder / name for folder in _BUILT_IN]
    return next(path for path in paths if path.is_dir())


@checked
def load_scene(name_or_path: str | Path, folder: Path | None = None) -> Scene:
    """The scene in a folder (or of its scene.toml), else the built-in one of that name.

    folder: where relative paths are looked up first, before the current one and the built-in
    scenes.
    Raises SceneError where none is found, and as `read_scene`.
    """
    if not isinstance(name_or_path, str | Path) or not str(name_or_path):
        raise SceneError("scene", f"{name_or_path!r}", "a scene's folder or name")
    for base in (*([folder] if folder else []), Path(), *_BUILT_IN):
        path = base / name_or_path
        if path.name == FILE and is_file(path):
            path = path.parent
        if is_file(path / FILE):
            return read_scene(path)
    raise SceneError(
        "scene",
        f"{sanitized(name_or_path)!r} was not found",
        f"a folder with a {FILE}, or one of: {', '.join(scene_names())}",
    )


def read_scene(folder: Path) -> Scene:
    """The scene of one folder, by its scene.toml.

    Raises SceneError, with the file and the key, for a file that cannot be read, a key that is
    wrong, and a model file that is missing.
    """
    path = folder / FILE
    file = validate(_File, read_toml(path, SceneError, "scene"), SceneError, f"{path}: {{}}")
    try:
        return _scene(file, folder.resolve())
    except (SceneError, QuantityError) as error:
        raise SceneError(f"{path}: {error.slot}", error.got, error.expected, error.advice) from None


def _models(file: _File, folder: Path) -> dict[str, dict[str, Path]]:
    """Paths of an engine's own models, by engine and role. Raises SceneError for a missing file.

    folder: of the scene, where the names start.
    """
    models = {}
    for engine, roles in file.models.items():
        models[engine] = {role: _model(folder, engine, role, name) for role, name in roles.items()}
    return models


def _scene(file: _File, folder: Path) -> Scene:
    """The scene that a file describes; values with units become SI.

    folder: of the scene, absolute, whose name the scene has.
    Raises SceneError for values that no scene has and a missing model file, QuantityError for text
    that is not a stiffness.
    """
    ball = file.ball
    plate = file.plate
    law = file.law
    return Scene(
        name=folder.name,
        title=file.title or folder.name,
        form=file.form,
        mass=ball.mass,
        ball_radius=ball.radius,
        plate_radius=plate.radius,
        ball_material=ball.material("ball"),
        plate_material=plate.material("plate"),
        stiffness=units.parse(law.stiffness, "stiffness", "law.stiffness", law.exponent),
        exponent=law.exponent,
        gravity=file.gravity,
        friction=file.friction,
        models=_models(file, folder),
    )


def _model(folder: Path, engine: str, role: str, name: str) -> Path:
    """Path of a model file in the folder of a scene. Raises SceneError where it is not there.

    engine, role: what the file is for, for the error.
    name: of the file, relative to the folder.
    """
    path = folder / name
    _require(
        f"models.{engine}.{role}",
        is_file(path),
        f"{sanitized(name, 60)!r} is not there",
        f"a file in {folder}",
    )
    return path
