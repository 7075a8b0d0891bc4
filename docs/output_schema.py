"""Every field that `--json` prints: types, the JSON Schema and the page of fields, made from one description.

    python docs/output_schema.py   writes docs/reference/outputs.schema.json and the fields in json.md

Records that the code has as dataclasses are taken from them. A number is null where there is no such number.
"""

from __future__ import annotations

import dataclasses
import json
import tomllib
import types
import typing
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

from pydantic import ConfigDict, Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from hcbench.cases.schema import type_name
from hcbench.checking.outcome import Verdict
from hcbench.fitting.budget import Budget
from hcbench.fitting.estimates import Estimate
from hcbench.fitting.flags import Flag
from hcbench.impact import Status, Tangential
from hcbench.laws.impact_law import ImpactSummary
from hcbench.measuring.measurement import Cause
from hcbench.recipes.target import Target
from hcbench.scoring import Score
from hcbench.sim.landing import Footfall, Landings
from hcbench.sim.rest import Rest
from hcbench.sim.tangential import ALONG_COLUMNS
from hcbench.tuning.evaluate import Evaluation

SCHEMA = Path(__file__).parent / "reference" / "outputs.schema.json"
PAGE = SCHEMA.with_name("json.md")
BEGIN, END = "<!-- begin fields: python docs/output_schema.py -->\n", "<!-- end fields -->"

Number = float | None
Text = str
Texts, Numbers = list[str], list[Number]
Pair = list[str]


def record(name: str, fields: dict[str, Any]) -> Any:
    """A record of these fields and no other, each with its meaning."""
    described = {key: _described(name, key, kind) for key, kind in fields.items()}
    return with_config(ConfigDict(extra="forbid"))(TypedDict(name, described))  # type: ignore[operator]


def _described(name: str, key: str, kind: Any) -> Any:
    if typing.get_origin(kind) is NotRequired:
        return NotRequired[_described(name, key, typing.get_args(kind)[0])]
    return Annotated[kind, Field(description=MEANING.get(f"{name}.{key}") or MEANING[key])]


def of_class(kind: type, optional: tuple[str, ...] = ()) -> Any:
    """The record of a dataclass of the code."""
    hints = typing.get_type_hints(kind)
    fields = {f.name: _json_type(hints[f.name]) for f in dataclasses.fields(kind)}
    return record(kind.__name__, {k: NotRequired[v] if k in optional else v for k, v in fields.items()})


def _json_type(hint: Any) -> Any:
    """A type of the code as JSON: tuples are lists, floats may be null, dataclasses are records."""
    if hint is float:
        return Number
    if dataclasses.is_dataclass(hint):
        return of_class(hint)  # type: ignore[arg-type]
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        return list[_json_type(inside[0])]  # type: ignore[misc]
    if origin in (typing.Union, types.UnionType):
        return typing.Union[tuple(_json_type(each) for each in inside)]  # noqa: UP007
    return hint


MEANING = tomllib.loads(Path(__file__).with_name("field_meanings.toml").read_text(encoding="utf-8"))

CURVE_POINT = record(
    "CurvePoint",
    {
        "speed_m_per_s": Number,
        "speed_in_m_per_s": Number,
        "restitution": Number,
        "restitution_min": Number,
        "restitution_max": Number,
        "restitution_after_force": Number,
        "target": Number,
        "error": Number,
        "error_worst_phase": Number,
        "samples": int,
        "failed": int,
        "angle_rad": NotRequired[Number],
        **dict.fromkeys(ALONG_COLUMNS, NotRequired[Number]),
    },
)
IMPACT = record(
    "Impact",
    {
        "speed_m_per_s": float,
        "phase": float,
        "angle_rad": NotRequired[float],
        "status": Literal[tuple(each.value for each in Status)],  # type: ignore[valid-type]
        "reason": Text,
        **dict.fromkeys(
            (
                *("speed_in_m_per_s", "speed_out_m_per_s", "restitution", "restitution_after_force"),
                *("duration_s", "penetration_max_m", "force_max_n"),
            ),
            Number,
        ),
        "samples": int,
        "tangential": NotRequired[of_class(Tangential)],
    },
)
LOOP = record(
    "Loop",
    {
        "speed_m_per_s": float,
        "phase": float,
        **dict.fromkeys(("time_s", "penetration_m", "rate_m_per_s", "force_n"), Numbers),
    },
)
MEASURE = record(
    "Measurement",
    {
        "schema": Literal[1],
        "kind": Literal["hcbench measurement"],
        "model": Text,
        "engine": Text,
        "version": Text,
        "pair": Pair,
        "moved": Text,
        "timestep_s": float,
        "gravity_m_per_s2": Numbers,
        "effective_mass_kg": Number,
        "normal": Numbers,
        "point_m": Numbers,
        "speed_shares": dict[str, Number],
        "settings": dict[str, Any],
        "model_asks": record("ModelAsks", {"restitution": Numbers, "description": Text}),
        "target": Text | None,
        "curve": list[CURVE_POINT],
        "phase_spread": Number,
        "energy_gained": bool,
        "law": record(
            "FittedLaw",
            {
                "alpha_s_per_m": Number,
                "stiffness_n_per_m_n": Number,
                "exponent": Number,
                "alpha_fitted": bool,
            },
        )
        | None,
        "score": of_class(Score) | None,
        "impacts": list[IMPACT],
        "loops": list[LOOP],
        "causes": list[of_class(Cause)],
        "remedy": Text,
        "rest": record(
            "AtRest",
            dict.fromkeys(("penetration_m", "vibration_m_per_s", "force_noise", "sinking_m_per_s"), Number),
        )
        | None,
        "rest_causes": list[of_class(Cause)],
        "notes": Texts,
    },
)
CHECK = record(
    "Check",
    {
        "schema": Literal[2],
        "kind": Literal["hcbench check"],
        "exit_code": int,
        "checks": list[
            record(
                "CheckOutcome",
                {
                    "name": Text,
                    "verdict": Literal[tuple(each.value for each in Verdict)],  # type: ignore[valid-type]
                    "exit_code": int,
                    "message": Text,
                    "against": Text,
                    "max_error": Number,
                    "worst": CURVE_POINT | None,
                    "rows": list[CURVE_POINT],
                    "measurement": MEASURE | None,
                },
            )
        ],
    },
)
CHOICE = record(
    "Choice",
    {
        "kind": Literal["exact", "settings", "constant"],
        "setting": Text,
        "line": Text,
        "within": Text,
        "energy": Text,
        "scenes": int | None,
        "text": Text,
        "max_error": Number,
        "speeds_m_s": Numbers,
        "max_e": Number,
        "passive": record("Passive", {"sphere": bool | None, "flat": bool | None}) | None,
        "rests": bool | None,
        "needs": Texts,
    },
)
REST = record("RestOfBody", {"rests": bool, **{f.name: Number for f in dataclasses.fields(Rest)}})
TUNE = record(
    "Tune",
    {
        "schema": Literal[1],
        "engine": Text,
        "recipe": Text,
        "kind": Literal["exact", "settings", "constant"],
        "requested": Text,
        "pair": Pair,
        "why": Text,
        "target": of_class(Target),
        "timestep_s": float,
        "options": dict[str, Any],
        "evaluation": of_class(Evaluation) | None,
        "rest": REST | None,
        "slope_drift_m_s": Number,
        "warning": Text,
        "advice": Texts,
        "notes": Texts,
        "paste": Text,
        "choices": list[CHOICE],
        "never": list[record("Never", {"setting": Text, "why": Text})],
        "band_note": Text,
        "caution": Text,
        "restitution_margin_95": Number,
        "certificate": NotRequired[dict[str, Any]],
    },
)
TUNED_PAIR = record(
    "TunedPair",
    {
        "pair": Pair,
        "attitude": Text,
        "effective_mass_kg": Number,
        "max_error": Number,
        "curve": list[CURVE_POINT],
    },
)
STANDING = dict.fromkeys(
    (
        *("penetration_m", "drift_m_per_s", "hold_m_per_s", "vibration_m_per_s", "solver_iterations"),
        *("step_time_s", "force_noise"),
    ),
    Number,
)
TUNE_MODEL = record(
    "TuneModel",
    {
        "schema": Literal[1],
        "kind": Literal["hcbench tuned model"],
        "model": Text,
        "engine": Text,
        "timestep_s": float,
        "gravity_m_per_s2": Numbers,
        "setting": Text,
        "max_error": Number,
        "gains": bool,
        "passive": dict[str, bool],
        "pairs": list[TUNED_PAIR],
        "before": record("Before", {**STANDING, "pairs": list[TUNED_PAIR]}),
        "after": record("After", STANDING),
        "worse": Texts,
        "taken_by_joints": Number,
        "paste": Text,
        "notes": Texts,
    },
)
ESTIMATE = dict[str, Number]
FIT = record(
    "Fit",
    {
        "schema": int,
        "kind": Literal["hcbench fit"],
        "files": list[record("FitFile", {"name": Text, "kind": Text, "impacts": NotRequired[int]})],
        "law": Text | None,
        "law_asked": Text,
        "alpha_s_per_m": Number,
        "alpha_standard_uncertainty_s_per_m": Number,
        "alpha_interval_95_s_per_m": Numbers | None,
        "restitution": Number,
        "restitution_standard_uncertainty": NotRequired[Number],
        "restitution_interval_95": Numbers | None,
        "speed_range_m_per_s": Numbers,
        "laws": list[
            record(
                "FittedCandidate",
                {"law": Text, "log_likelihood": Number, "odds": Number, "parameters": ESTIMATE},
            )
        ],
        "flagged": list[of_class(Flag)],
        "doubts": NotRequired[Texts],
        "reservation": NotRequired[Text],
        "odds_none_of_these_laws": NotRequired[Number],
        "constant_loss_e0": NotRequired[ESTIMATE | None],
        "scatter": NotRequired[Number],
        "noise": NotRequired[
            list[record("Noise", {"file": Text, "value": Number, "unit": Text, "given": bool})]
        ],
        "drops": NotRequired[list[record("Drop", {"file": Text, "doubts": Texts, "alpha": ESTIMATE | None})]],
        "between_drops": NotRequired[Number],
        "warnings": NotRequired[Texts],
        "budget": NotRequired[of_class(Budget)],
        "max_error": NotRequired[Number],
        "against": NotRequired[
            list[
                record(
                    "Comparison",
                    {
                        "files": Texts,
                        "compared": Literal["alpha", "one_minus_e"],
                        "ratio": of_class(Estimate),
                        "differ": bool,
                    },
                )
            ]
        ],
        "scene": NotRequired[
            record(
                "FittedScene",
                {
                    "engine": Text,
                    "recipe": Text,
                    "timestep_s": float,
                    "alpha_s_per_m": Number,
                    "recorded_s": Numbers,
                    "simulated_s": Numbers,
                    "largest_error_s": Number,
                },
            )
        ],
        "restitution_by_shape": NotRequired[Number],
        "shape_contradicts_impulse": NotRequired[bool],
        "stiffness_n_per_m_n": NotRequired[Number],
        "exponent": NotRequired[Number],
        "covariance_ln_k_n_alpha": NotRequired[list[Numbers]],
        "misfit": NotRequired[Number],
    },
)
DROPPED = record(
    "RobotDrop",
    {
        "height_m": float,
        "tilt_rad": float,
        **dict.fromkeys(("speed_in_m_per_s", "restitution", "peak_over_weight", "impulse_n_s"), Number),
        **dict.fromkeys(("contact_s", "slip_m", "penetration_m"), Number),
        "feet_that_bounce": int,
        "speed_out_m_per_s": Number,
        "feet": list[of_class(Footfall)],
        **dict.fromkeys(("time_s", "force_n"), Numbers),
    },
)
LAND = record(
    "Landing",
    {
        "schema": Literal[1],
        "kind": Literal["hcbench landing"],
        **{f.name: typing.get_type_hints(Landings)[f.name] for f in dataclasses.fields(Landings)},
        "window_s": float,
        "drops": list[DROPPED],
    },
)
PAIRS = list[
    record(
        "CandidatePair",
        {
            "pair": Text,
            **dict.fromkeys(("bodies", "geoms", "types"), Pair),
            "joint": Text,
            "effective_mass_kg": Number,
            "distance_m": Number,
            "touching": bool,
            "touching_in": Texts,
            "contact": dict[str, Any],
        },
    )
]
ENGINES = list[
    record(
        "Engine",
        {
            **dict.fromkeys(("name", "version", "install"), Text),
            "settings": dict[str, str],
            "python": Text,
            "size_bytes": int | None,
            "where": Text,
        },
    )
]
CONVERT = record(
    "Convert",
    {
        "alpha_s_per_m": Number,
        "speed_m_per_s": Number,
        "restitution": Number,
        "restitution_linear": Number,
        "rows": list[
            record(
                "Parameter",
                {"system": Text, "parameter": Text, "value": Numbers, "unit": Text, "note": Text},
            )
        ],
        "missing": Texts,
        "caveats": Texts,
    },
)
OUTPUTS: dict[str, Any] = {
    "measure": MEASURE,
    "check": CHECK,
    "tune": TUNE,
    "tune MODEL": TUNE_MODEL,
    "fit": FIT,
    "pairs": PAIRS,
    "land": LAND | list[LAND],
    "engines": ENGINES,
    "convert": CONVERT,
    "law": list[of_class(ImpactSummary)],
}


def schema() -> dict[str, Any]:
    """The JSON Schema: one definition a command, and the records in them."""
    definitions: dict[str, Any] = {}
    for command, kind in OUTPUTS.items():
        own = TypeAdapter(kind).json_schema(ref_template="#/$defs/{model}")
        definitions |= own.pop("$defs", {})
        definitions[f"hcbench {command} --json"] = own
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "$defs": definitions}


def fields() -> str:
    """The page's tables: one a command, then one a record."""
    definitions = schema()["$defs"]
    parts = []
    for name in sorted(definitions, key=lambda name: not name.startswith("hcbench ")):
        about = definitions[name]
        if "properties" not in about:
            parts.append(f"## `{name}`\n\nA {_type(about)}.\n")
            continue
        rows = [
            f"| `{key}` | {_type(each)} | {each['description']} |"
            for key, each in about["properties"].items()
        ]
        title = f"## `{name}`" if name.startswith("hcbench ") else f"### {name}"
        parts.append("\n".join([title, "", "| field | type | meaning |", "|---|---|---|", *rows, ""]))
    return "\n" + "\n".join(parts) + "\n"


def _type(each: dict[str, Any]) -> str:
    return type_name(each, lambda record: f"[{record}](#{record.lower()})")


def write() -> None:
    """Write the schema and the page's tables."""
    SCHEMA.write_text(json.dumps(schema(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
    PAGE.write_text(head + BEGIN + fields() + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    write()
