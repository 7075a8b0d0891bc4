"""A scene: what is dropped on what. Reads the folders under scenes/."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictInt, ValidationError

from hcbench import units
from hcbench.errors import QuantityError, SceneError

if TYPE_CHECKING:
    from collections.abc import Mapping

FILE = "scene.toml"
_PACKAGE = Path(__file__).parent
_BUILT_IN = (_PACKAGE.parent / "scenes", _PACKAGE / "data" / "scenes")  # a checkout's, a wheel's


def _require(slot: str, good: bool, got: str, expected: str, todo: str = "") -> None:
    if not good:
        raise SceneError(slot, got, expected, todo)


@dataclass(frozen=True, slots=True)
class Material:
    """Elastic constants of a body: young_modulus Pa, poisson_ratio 1."""

    young_modulus: float
    poisson_ratio: float

    def __post_init__(self) -> None:
        E, nu = self.young_modulus, self.poisson_ratio
        _require("young_modulus", 0 < E < math.inf, f"{E!r} Pa", "above 0 Pa")
        _require("poisson_ratio", -1 < nu < 0.5, f"{nu!r}", "within -1 ... 0.5, both excluded")


@dataclass(frozen=True, slots=True)
class Scene:
    """The truth about a drop, SI, and the engine files that say the same.

    form: "cup", the true concave plate; "plane", the equivalent sphere 1/(1/R1 + 1/R2) on a plane.
    ball_radius: R1, m. plate_radius: R2, m, negative when concave, inf when flat.
    stiffness: k, N/m^exponent. gravity: m/s^2 towards the plate, 0 for launches in free flight.
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
    models: Mapping[str, Mapping[str, Path]] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        R1, R2 = self.ball_radius, self.plate_radius
        _require("ball.mass", 0 < self.mass < math.inf, f"{self.mass!r} kg", "above 0 kg")
        _require("ball.radius", 0 < R1 < math.inf, f"{R1!r} m", "above 0 m")
        _require("plate.radius", R2 != 0 and not math.isnan(R2), f"{R2!r} m", "a radius other than 0 m")
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
        k, n, g = self.stiffness, self.exponent, self.gravity
        _require("law.stiffness", 0 < k < math.inf, f"{k!r} N/m^{n:g}", "above 0")
        _require("law.exponent", 1 <= n < math.inf, f"{n!r}", "1 or more")
        _require("gravity", 0 <= g < math.inf, f"{g!r} m/s^2", "0 m/s^2 or more, towards the plate")

    @property
    def relative_radius(self) -> float:
        """R = 1/(1/R1 + 1/R2), m: the sphere that meets a plane as this pair meets."""
        return 1.0 / (
            1.0 / self.ball_radius + (0.0 if math.isinf(self.plate_radius) else 1.0 / self.plate_radius)
        )


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class _Body(_Table):
    radius: Any = Field(description="a length in m, or text like '1 in'")
    young_modulus: Any = Field(description="a pressure in Pa, or text like '30e6 psi'")
    poisson_ratio: Any = Field(description="a number like 0.3")


class _Ball(_Body):
    mass: Any = Field(description="a mass in kg, or text like '1 lb'")


class _Law(_Table):
    stiffness: Any = Field(description="k in N/m^exponent, or text like '3.1e7 lbf/in^1.5'")
    exponent: Any = Field(default=1.5, description="a number of 1 or more")


class _File(_Table):
    """A scene.toml: its tables and keys. Quantities are read later, as they need units."""

    schema_: StrictInt = Field(
        alias="schema", ge=1, le=1, description="1, the version that this hcbench reads"
    )
    title: str = Field(default="", description="text")
    form: Literal["cup", "plane"] = Field(description="'cup' or 'plane'")
    gravity: Any = Field(default=0.0, description="an acceleration in m/s^2")
    ball: _Ball = Field(description="a [ball] table")
    plate: _Body = Field(description="a [plate] table")
    law: _Law = Field(description="a [law] table")
    models: dict[str, dict[str, str]] = Field(
        default_factory=dict, description="[models.ENGINE] tables of file names"
    )


def scene_names() -> list[str]:
    """The built-in scenes, sorted."""
    return sorted({file.parent.name for folder in _BUILT_IN for file in folder.glob(f"*/{FILE}")})


def built_in_folder(name: str) -> Path:
    """The folder of that name among the built-in scenes."""
    return next(path for folder in _BUILT_IN if (path := folder / name).is_dir())


def load_scene(name_or_path: str | Path, folder: Path | None = None) -> Scene:
    """The scene in a folder (or of its scene.toml), else the built-in one of that name.

    folder: where relative paths are looked up first. Raises SceneError.
    """
    if not isinstance(name_or_path, str | Path) or not str(name_or_path):
        raise SceneError("scene", f"{name_or_path!r}", "a scene's folder or name")
    for base in (*([folder] if folder else []), Path(), *_BUILT_IN):
        path = base / name_or_path
        if path.name == FILE and path.is_file():
            path = path.parent
        if (path / FILE).is_file():
            return read_scene(path)
    raise SceneError(
        "scene",
        f"{str(name_or_path)!r} was not found",
        f"a folder with a {FILE}, or one of: {', '.join(scene_names())}",
    )


def read_scene(folder: Path) -> Scene:
    """The scene of one folder; SceneError names the file, the slot and what to do."""
    path = folder / FILE
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise SceneError(str(path), str(error), "a readable TOML file") from None
    except tomllib.TOMLDecodeError as error:
        raise SceneError(str(path), f"not TOML: {error}", "TOML", "Mend that line") from None
    try:
        return _scene(_File.model_validate(content), folder.resolve())
    except ValidationError as error:
        slot, got, expected = _first(error)
        raise SceneError(f"{path}: {slot}", got, expected) from None
    except (SceneError, QuantityError) as error:
        raise SceneError(f"{path}: {error.slot}", error.got, error.expected, error.todo) from None


def _scene(file: _File, folder: Path) -> Scene:
    ball, plate, law = file.ball, file.plate, file.law
    n = units.parse(law.exponent, "number", "law.exponent")
    flat = plate.radius == math.inf
    return Scene(
        name=folder.name,
        title=file.title or folder.name,
        form=file.form,
        mass=units.parse(ball.mass, "mass", "ball.mass"),
        ball_radius=units.parse(ball.radius, "length", "ball.radius"),
        plate_radius=math.inf if flat else units.parse(plate.radius, "length", "plate.radius"),
        ball_material=_material(ball, "ball"),
        plate_material=_material(plate, "plate"),
        stiffness=units.parse(law.stiffness, "stiffness", "law.stiffness", n),
        exponent=n,
        gravity=units.parse(file.gravity, "acceleration", "gravity"),
        models={
            engine: {role: _model(folder, engine, role, name) for role, name in roles.items()}
            for engine, roles in file.models.items()
        },
    )


def _material(body: _Body, slot: str) -> Material:
    E = units.parse(body.young_modulus, "pressure", f"{slot}.young_modulus")
    nu = units.parse(body.poisson_ratio, "number", f"{slot}.poisson_ratio")
    try:
        return Material(E, nu)
    except SceneError as error:
        raise SceneError(f"{slot}.{error.slot}", error.got, error.expected) from None


def _model(folder: Path, engine: str, role: str, name: str) -> Path:
    path = folder / name
    _require(f"models.{engine}.{role}", path.is_file(), f"{name!r} is not there", f"a file in {folder}")
    return path


def _first(error: ValidationError) -> tuple[str, str, str]:
    """Slot, what came and what was expected of the first thing that is wrong with a scene.toml."""
    what = error.errors(include_url=False)[0]
    names = [str(part) for part in what["loc"]]
    table: type[BaseModel] = _File
    expected = what["msg"]
    for name in names:
        fields = {f.alias or key: f for key, f in table.model_fields.items()}
        if name not in fields:
            if table is not _File or what["type"] == "extra_forbidden":
                expected = f"one of: {', '.join(fields)}"
            break
        expected = fields[name].description or expected
        inner = fields[name].annotation
        if not (isinstance(inner, type) and issubclass(inner, BaseModel)):
            break
        table = inner
    got = {"missing": "missing", "extra_forbidden": "unknown key"}.get(what["type"], f"{what['input']!r:.60}")
    return ".".join(names), got, expected
