"""What a MuJoCo setting may say, checked strictly: MuJoCo itself clamps, warns or ignores in silence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from hcbench.engines.mujoco.rows import ConstraintRow
from hcbench.errors import SettingError
from hcbench.laws.contact_law import law_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.laws.contact_law import Law

INTEGRATORS = ("Euler", "implicit", "implicitfast", "RK4", "discrete")
_KEYS = ("integrator", "rows", "law")
_ROW_KEYS = ("solref", "solimp", "onset", "adhesion")


@dataclass(frozen=True, slots=True)
class Options:
    """A setting's options, checked. integrator None, no rows and no law: the model as authored."""

    integrator: str | None
    rows: tuple[ConstraintRow, ...]
    law: Law | None = None


def read_options(options: Mapping[str, Any]) -> Options:
    """Options from a setting; SettingError names the first one that MuJoCo does not have."""
    _known(options, _KEYS, "")
    integrator = options.get("integrator")
    if integrator is not None and integrator not in INTEGRATORS:
        raise SettingError(
            "mujoco option 'integrator'", f"{integrator!r}", f"one of: {', '.join(INTEGRATORS)}"
        )
    rows = options.get("rows", [])
    if not isinstance(rows, list | tuple):
        raise SettingError("mujoco option 'rows'", f"{rows!r:.60}", "a list of contact constraints")
    law = _law(options["law"]) if "law" in options else None
    if law is not None and rows:
        raise SettingError("mujoco option 'law'", "given with rows", "one of the two")
    return Options(integrator, tuple(_row(row, f"rows[{i}]") for i, row in enumerate(rows)), law)


def _law(given: Any) -> Law:
    if not hasattr(given, "items"):
        raise SettingError("mujoco option 'law'", f"{given!r:.60}", 'a table such as {"kind": "force", ...}')
    return law_of(given)


def _row(given: Any, part: str) -> ConstraintRow:
    if not hasattr(given, "items"):
        raise SettingError(f"mujoco option '{part}'", f"{given!r:.60}", f"a table of {', '.join(_ROW_KEYS)}")
    _known(given, _ROW_KEYS, f"{part}.")
    row = ConstraintRow(
        solref=_numbers(given, "solref", 2, part),
        solimp=_numbers(given, "solimp", 5, part),
        onset=_number(given.get("onset", 0.0), f"{part}.onset"),
        adhesion=_number(given.get("adhesion", 0.0), f"{part}.adhesion"),
    )
    if (row.solref[0] > 0) != (row.solref[1] > 0):
        raise SettingError(
            f"mujoco option '{part}.solref'",
            f"{list(row.solref)}",
            "two numbers above 0 (time constant and damping ratio) or none (-stiffness and -damping)",
        )
    if row.adhesion < 0:
        raise SettingError(f"mujoco option '{part}.adhesion'", f"{row.adhesion!r} N", "0 N or more")
    return row


def _known(given: Mapping[str, Any], keys: tuple[str, ...], part: str) -> None:
    for key in given:
        if key not in keys:
            raise SettingError(f"mujoco option '{part}{key}'", "unknown", f"one of: {', '.join(keys)}")


def _numbers(given: Mapping[str, Any], key: str, count: int, part: str) -> tuple[float, ...]:
    slot, values = f"{part}.{key}", given.get(key)
    if not isinstance(values, list | tuple) or len(values) != count:
        raise SettingError(f"mujoco option '{slot}'", f"{values!r:.60}", f"a list of {count} numbers")
    return tuple(_number(value, slot) for value in values)


def _number(value: Any, slot: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise SettingError(f"mujoco option '{slot}'", f"{value!r}", "a finite number")
    return float(value)
