"""Options of a MuJoCo setting, checked strictly: MuJoCo itself clamps, warns or ignores in silence."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from pydantic import Field, ValidationInfo, field_validator

from hcbench.engines.mujoco.scene.rows import ConstraintRow
from hcbench.laws.contact_law import Law, law_of
from hcbench.system.errors import SettingError
from hcbench.terms.fields import Finite, OptionTable, mistake, validate

_Integrator = Literal["Euler", "implicit", "implicitfast", "RK4", "discrete"]
_Cone = Literal["pyramidal", "elliptic"]
INTEGRATORS: tuple[str, ...] = get_args(_Integrator)


class _RowTable(OptionTable):
    solref: tuple[Finite, Finite] = Field(
        None, validate_default=True, description="a list of 2 numbers"
    )
    solimp: tuple[Finite, Finite, Finite, Finite, Finite] = Field(description="a list of 5 numbers")
    onset: Finite = 0.0
    adhesion: Finite = 0.0
    friction: Finite = 0.0
    solreffriction: tuple[Finite, Finite] | tuple[()] = Field((), description="a list of 2 numbers")

    @field_validator("solref")
    @classmethod
    def _one_form(cls, solref: tuple[float, float]) -> tuple[float, float]:
        if (solref[0] > 0) != (solref[1] > 0):
            forms = "two numbers above 0 (time constant and damping ratio) or none (-stiffness and -damping)"
            raise mistake(forms)
        return solref

    @field_validator("adhesion", "friction")
    @classmethod
    def _not_negative(cls, value: float, info: ValidationInfo) -> float:
        if value < 0:
            unit = " N" if info.field_name == "adhesion" else ""
            raise mistake(f"0{unit} or more", f"{value!r}{unit}")
        return value


class _Table(OptionTable):
    integrator: _Integrator | None = Field(None, description=f"one of: {', '.join(INTEGRATORS)}")
    cone: _Cone | None = Field(None, description=f"one of: {', '.join(get_args(_Cone))}")
    impratio: Finite | None = Field(None, gt=0, description="a number above 0")
    rows: tuple[_RowTable, ...] = Field((), description="a list of contact constraints")
    law: Any = None


@dataclass(frozen=True, slots=True)
class Options:
    """A setting's options, checked. None, no rows and no law: the model as authored."""

    integrator: str | None
    rows: tuple[ConstraintRow, ...]
    law: Law | None = None
    cone: str | None = None
    impratio: float | None = None

    def attributes(self, number: Callable[[float], str] = repr) -> dict[str, str]:
        """Attributes of a model's <option> that are set, except the step.

        number: writes one.
        """
        ratio = None if self.impratio is None else number(self.impratio)
        texts = {"integrator": self.integrator, "cone": self.cone, "impratio": ratio}
        return {key: text for key, text in texts.items() if text is not None}


def read_options(options: Mapping[str, Any]) -> Options:
    """Options from a setting; SettingError names the first one that MuJoCo does not have."""
    table = validate(_Table, options, SettingError, "mujoco option '{}'")
    law = None
    if table.law is not None:
        law = law_of(table.law)
        if table.rows:
            raise SettingError("mujoco option 'law'", "given with rows", "one of the two")
    rows = tuple(ConstraintRow(**row.model_dump()) for row in table.rows)
    return Options(table.integrator, rows, law, table.cone, table.impratio)
