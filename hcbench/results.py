"""What a study found: tidy tables, the settings used, versions and provenance. Written whole or not at all.

restitution.csv  one row an impact           loops.csv     one row a sample of a kept loop
scores.csv       one row a setting, α, step  summary.json  schema, study, settings, versions
"""

from __future__ import annotations

import io
import json
import math
import os
import shutil
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from hcbench.compare import CLAIMS
from hcbench.errors import OutputError, UserError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

SCHEMA = 1
# Before version 3 pandas reads the last digit wrong unless told not to; since then it must not be told.
_EXACT: dict[str, Any] = {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
RUN_KEY = ["scene", "engine", "setting", "alpha_s_per_m", "timestep_s"]  # one setting at one step for one α

IMPACT_COLUMNS = [
    *RUN_KEY,
    "speed_m_per_s",
    "phase",
    "status",
    "reason",
    "speed_in_m_per_s",
    "speed_out_m_per_s",
    "restitution",
    "restitution_law",
    "restitution_linear",
    "duration_s",
    "penetration_max_m",
    "force_max_n",
    "samples",
]
TABLES = ("restitution", "loops", "scores", "trains")
TRAIN_COLUMNS = [*RUN_KEY, "bounce", "height_m", "height_law_m"]
LOOP_COLUMNS = [*RUN_KEY, "speed_m_per_s", "phase", "time_s", "penetration_m", "rate_m_per_s", "force_n"]


@dataclass(frozen=True, slots=True)
class Results:
    """Everything a report or a check reads.

    study: the study file's content with its defaults filled in. settings: one record a run key.
    versions: package -> version. impacts, loops, scores: tables, columns as above.
    """

    study: Mapping[str, Any]
    settings: Sequence[Mapping[str, Any]]
    versions: Mapping[str, str]
    impacts: pd.DataFrame
    loops: pd.DataFrame
    scores: pd.DataFrame
    trains: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=TRAIN_COLUMNS))

    def summary(self) -> dict[str, Any]:
        """The part that is not a table, JSON-able."""
        return {
            "schema": SCHEMA,
            "kind": "hcbench results",
            "study": self.study,
            "versions": self.versions,
            "settings": list(self.settings),
            "impacts": len(self.impacts),
            "scores": json.loads(self.scores.to_json(orient="records", double_precision=15)),
        }

    def write(self, folder: Path) -> None:
        """Write the files into an existing folder."""
        tables = {
            "restitution": self.impacts,
            "loops": self.loops,
            "scores": self.scores,
            "trains": self.trains,
        }
        for name, table in tables.items():
            write_text(folder / f"{name}.csv", csv_text(table))
        write_text(folder / "summary.json", json_text(self.summary()))

    @classmethod
    def read(cls, folder: Path) -> Results:
        """Read what `write` wrote; UserError for a folder that is not one, or of another schema."""
        try:
            summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
            tables = [_read_table(folder / f"{name}.csv") for name in TABLES]
        except (OSError, ValueError) as error:
            raise UserError("results", f"{folder}: {error}", "a folder that `hcbench report` wrote") from None
        if summary.get("schema") != SCHEMA:
            raise UserError(
                "results",
                f"{folder} has schema {summary.get('schema')!r}",
                f"schema {SCHEMA}",
                "Run the study again with this version of hcbench",
            )
        return cls(summary["study"], summary["settings"], summary["versions"], *tables)


def _read_table(path: Path) -> pd.DataFrame:
    # An empty number is NaN, but an empty reason is an empty text and an empty claim "not resolved".
    table: pd.DataFrame = pd.read_csv(path, dtype=dict.fromkeys(["reason", *CLAIMS], "object"), **_EXACT)
    if "reason" in table:
        table["reason"] = table["reason"].fillna("")
    for claim in CLAIMS:
        if claim in table:
            table[claim] = table[claim].map({"True": True, "False": False}).astype("object")
            table.loc[table[claim].isna(), claim] = None
    return table


def csv_text(table: pd.DataFrame) -> str:
    """CSV with every float in the fewest digits that read back the same."""
    buffer = io.StringIO()
    table.to_csv(buffer, index=False, lineterminator="\n")
    return buffer.getvalue()


def json_text(content: Any) -> str:
    """JSON, stable and with no NaN (null instead)."""
    return json.dumps(_no_nan(content), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _no_nan(content: Any) -> Any:
    if isinstance(content, dict):
        return {k: _no_nan(v) for k, v in content.items()}
    if isinstance(content, list | tuple):
        return [_no_nan(v) for v in content]
    return None if isinstance(content, float) and math.isnan(content) else content


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: into a neighbour first, then renamed."""
    try:
        handle, neighbour = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            mask = os.umask(0)
            os.umask(mask)
            Path(neighbour).chmod(0o666 & ~mask)  # mkstemp makes it private
            Path(neighbour).replace(path)
        except BaseException:
            Path(neighbour).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise OutputError("output", f"{path}: {error.strerror}", "a place that can be written to") from None


@contextmanager
def filled_folder(folder: Path) -> Iterator[Path]:
    """A scratch folder whose files move into `folder` when the block ends well; else nothing is left."""
    made = [p for p in (folder, *folder.parents) if not p.exists()]
    scratch = None
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".hcbench-", dir=folder))
    except OSError as error:
        raise OutputError(
            "output folder", f"{folder}: {error.strerror}", "a folder that can be written to"
        ) from None
    try:
        yield scratch
        for item in sorted(scratch.rglob("*")):
            if item.is_file():
                target = folder / item.relative_to(scratch)
                target.parent.mkdir(parents=True, exist_ok=True)
                item.replace(target)
    except BaseException as error:
        shutil.rmtree(scratch, ignore_errors=True)
        for path in made:
            if path.exists() and not any(path.iterdir()):
                path.rmdir()
        if isinstance(error, OSError):
            raise OutputError(
                "output folder", f"{folder}: {error.strerror}", "a folder that can be written to"
            ) from None
        raise
    shutil.rmtree(scratch, ignore_errors=True)
