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
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, NotRequired

from pydantic import ConfigDict, Field, TypeAdapter, with_config
from typing_extensions import TypedDict

from hcbench.cases.schema import type_name
from hcbench.catalogue.material import MaterialPair
from hcbench.checking.outcome import Verdict
from hcbench.fitting.budget import Budget
from hcbench.fitting.linear import Estimate
from hcbench.fitting.misfits import Flag
from hcbench.laws.impact_law import ImpactSummary
from hcbench.measuring.measurement import Cause
from hcbench.recipes.target import Target
from hcbench.scoring import Score
from hcbench.sim.landing import QUANTITIES, Footfall, Landings
from hcbench.sim.rest import Rest
from hcbench.terms import records
from hcbench.terms.impact import Tangential
from hcbench.terms.records import (
    ALONG,
    ANGLE,
    BOUNCE,
    CONTACT,
    CONTACT_IMPACT,
    CONTACT_LOAD,
    CONTACT_STEP,
    COULOMB,
    CURVE_POINT,
    IMPACT,
    LAID,
    LANDING,
    LANDING_PEAK,
    LOOP,
    PHASE,
    REST,
    RUN,
    SPEED,
    STUDY_IMPACT,
)
from hcbench.tuning.evaluate import Evaluation

SCHEMA = Path(__file__).parent / "reference" / "outputs.schema.json"
PAGE = SCHEMA.with_name("json.md")
CSV_PAGE = SCHEMA.with_name("report.md")
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
    if typing.get_origin(kind) is Annotated:
        return kind
    return Annotated[kind, Field(description=MEANING.get(f"{name}.{key}") or MEANING[key])]


def of_fields(*fields: records.Field) -> dict[str, Any]:
    """The keys of fields of the code, each with its type and meaning."""
    described = {}
    for each in fields:
        kind = each.kind if each.given else _json_type(each.kind)
        described[each.key] = Annotated[kind, Field(description=each.description)]
    optional = {each.key for each in fields if each.oblique}
    return {key: NotRequired[kind] if key in optional else kind for key, kind in described.items()}


def of_class(kind: type, optional: tuple[str, ...] = ()) -> Any:
    """The record of a dataclass of the code."""
    hints = typing.get_type_hints(kind)
    fields = {f.name: _json_type(hints[f.name]) for f in dataclasses.fields(kind)}
    return record(
        kind.__name__, {k: NotRequired[v] if k in optional else v for k, v in fields.items()}
    )


def _json_type(hint: Any) -> Any:
    """A type of the code as JSON: tuples are lists, floats may be null, dataclasses are records."""
    if hint is float:
        return Number
    if isinstance(hint, type) and issubclass(hint, Enum):
        return Literal[tuple(each.value for each in hint)]
    if dataclasses.is_dataclass(hint):
        return of_class(hint)  # type: ignore[arg-type]
    origin, inside = typing.get_origin(hint), typing.get_args(hint)
    if origin in (tuple, list):
        return list[_json_type(inside[0])]  # type: ignore[misc]
    if origin in (typing.Union, types.UnionType):
        return typing.Union[tuple(_json_type(each) for each in inside)]  # noqa: UP007
    return hint


MEANING = tomllib.loads(Path(__file__).with_name("field_meanings.toml").read_text(encoding="utf-8"))

POINT = record("CurvePoint", of_fields(*CURVE_POINT))
ONE_IMPACT = record(
    "Impact", {**of_fields(*IMPACT), "tangential": NotRequired[of_class(Tangential)]}
)
ONE_LOOP = record("Loop", of_fields(SPEED, PHASE, *LOOP))
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
        "curve": list[POINT],
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
        "impacts": list[ONE_IMPACT],
        "loops": list[ONE_LOOP],
        "causes": list[of_class(Cause)],
        "remedy": Text,
        "rest": record("AtRest", of_fields(*REST)) | None,
        "rest_causes": list[of_class(Cause)],
        "contact": record(
            "ContactMeaning",
            {
                **of_fields(*CONTACT),
                "impacts": list[record("ContactImpact", of_fields(*CONTACT_IMPACT))],
                "loads": list[record("ContactLoad", of_fields(*CONTACT_LOAD))],
                "landings": list[record("LandingPeak", of_fields(*LANDING_PEAK))],
                "steps": list[record("ContactStep", of_fields(*CONTACT_STEP))],
            },
        )
        | None,
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
                    "worst": POINT | None,
                    "rows": list[POINT],
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
        "speeds_m_per_s": Numbers,
        "max_e": Number,
        "passive": record("Passive", {"sphere": bool | None, "flat": bool | None}) | None,
        "rests": bool | None,
        "needs": Texts,
    },
)
REST_OF_BODY = record(
    "RestOfBody", {"rests": bool, **{f.name: Number for f in dataclasses.fields(Rest)}}
)
TUNE = record(
    "Tune",
    {
        "schema": Literal[2],
        "engine": Text,
        "recipe": Text,
        "kind": Literal["exact", "settings", "constant"],
        "requested": Literal["exact", "settings", "constant"] | None,
        "pair": Pair,
        "why": Text,
        "target": of_class(Target),
        "timestep_s": float,
        "options": dict[str, Any],
        "evaluation": of_class(Evaluation) | None,
        "rest": REST_OF_BODY | None,
        "slope_drift_m_per_s": Number,
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
        "curve": list[POINT],
    },
)
STANDING = dict.fromkeys(
    (
        *(
            "penetration_m",
            "drift_m_per_s",
            "hold_m_per_s",
            "vibration_m_per_s",
            "hop_m",
            "solver_iterations",
        ),
        *("step_time_s", "force_noise"),
    ),
    Number,
)
LANDED = record(
    "Landed",
    of_fields(*records.REBOUND, *(each.field for each in QUANTITIES)),
)
STIFFER = record("StifferServos", {"kp_factor": float, "rebound_m": Number})
CHANGE = record(
    "LandingChange",
    {
        "target_rebound_m": Number,
        "before": LANDED,
        "after": LANDED,
        "worse": Texts,
        "reach": record("Reach", {"rebound_m": Number, "stiffer": list[STIFFER]}) | None,
        "advice": Texts,
    },
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
        "material": NotRequired[Text],
        "max_error": Number,
        "gains": bool,
        "passive": dict[str, bool | None],
        "pairs": list[TUNED_PAIR],
        "before": record("Before", {**STANDING, "pairs": list[TUNED_PAIR]}),
        "after": record("After", STANDING),
        "worse": Texts,
        "taken_by_joints": Number,
        "landing": CHANGE | None,
        "paste": Text,
        "notes": Texts,
    },
)
RANDOMIZE = record(
    "Randomize",
    {
        "schema": Literal[1],
        "layout": Literal[1],
        "kind": Literal["hcbench worlds"],
        "engine": Text,
        "version": Text,
        "model": Text,
        "pairs": list[Texts],
        "timestep_s": float,
        "gravity_m_per_s2": Numbers,
        "effective_mass_kg": Numbers,
        "contact": Text,
        "restitution": Numbers,
        "friction": Numbers | None,
        "seed": int,
        "lines": Text,
        "worlds": int,
        "parameters": Texts,
        "certified": int,
        "launches": int,
        "speeds_m_per_s": Numbers,
        "restitution_minus_mean": Numbers,
        "restitution_error": Number,
        "restitution_p": Number,
        "restitution_of_one_launch": Number,
        "friction_error": Number,
        "friction_p": Number,
        "energy_gained": Number,
        "before": record("BeforeWorlds", STANDING),
        "after": list[record("AfterWorlds", STANDING)],
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
        "drops": NotRequired[
            list[record("Drop", {"file": Text, "doubts": Texts, "alpha": ESTIMATE | None})]
        ],
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
        **of_fields(*LANDING, records.LANDING_SPEED_OUT),
        "other_phases": list[record("OtherPhase", of_fields(*LANDING))],
        "feet": list[of_class(Footfall)],
        **of_fields(records.LANDING_TIME, records.LANDING_FORCE),
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
    "randomize": RANDOMIZE,
    "fit": FIT,
    "measure MODEL": PAIRS,
    "land": LAND | list[LAND],
    "engines": ENGINES,
    "convert": CONVERT,
    "materials": MaterialPair | list[MaterialPair],
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
        parts.append(
            "\n".join([title, "", "| field | type | meaning |", "|---|---|---|", *rows, ""])
        )
    return "\n" + "\n".join(parts) + "\n"


def csv_columns() -> str:
    """The page's tables of the CSV files of a study."""
    every = {
        "every file; `scores.csv` has the fields of [Score](json.md#score) after them": RUN,
        "`restitution.csv`, an impact in each row": STUDY_IMPACT,
        "`restitution.csv` of a study with oblique launches, after those": (ANGLE, *ALONG, COULOMB),
        "`loops.csv`, a step of a kept loop in each row": (SPEED, PHASE, *LOOP),
        "`trains.csv`, a bounce in each row": BOUNCE,
        "`rests.csv`, a drop in each row": LAID,
    }
    parts = []
    for files, columns in every.items():
        rows = [f"| `{each.key}` | {each.description} |" for each in columns]
        parts.append(
            "\n".join([f"Of {files}:", "", "| column | meaning |", "|---|---|", *rows, ""])
        )
    return "\n" + "\n".join(parts) + "\n"


def _type(each: dict[str, Any]) -> str:
    return type_name(each, lambda record: f"[{record}](#{record.lower()})")


def write() -> None:
    """Write the schema and the tables of both pages."""
    SCHEMA.write_text(json.dumps(schema(), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for page, tables in ((PAGE, fields()), (CSV_PAGE, csv_columns())):
        head, rest = page.read_text(encoding="utf-8").split(BEGIN)
        page.write_text(head + BEGIN + tables + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    write()
