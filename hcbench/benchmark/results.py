"""The results of a study: tidy tables, the settings used, versions and provenance.

restitution.csv  one row an impact           loops.csv     one row a sample of a kept loop
scores.csv       one row a setting, α, step  trains.csv    one row a bounce of a drop under gravity
rests.csv        one row a drop: how the body lies at the end summary.json     schema (4; 1 and 2
have an earlier definition of e), study, settings, versions, answers hcbench-files.json: what of a
folder was written, so that the next time clears up after this one.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from hcbench.benchmark.fold import FOLDED, FOLDED_OBLIQUE, Folded, Folder
from hcbench.scoring import CLAIMS
from hcbench.system.errors import UserError
from hcbench.system.files import json_text, parse_json, read_text, write_bytes, write_text
from hcbench.system.notebook import Drawn
from hcbench.terms import records
from hcbench.terms.fields import ResultTable, validate
from hcbench.terms.impact import FORMER_E
from hcbench.terms.records import BOUNCE, LAID, LOOP, PHASE, RUN, SPEED, STUDY_IMPACT, keys

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    import pandas as pd

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

SCHEMA = 4
# Schemas of earlier versions, which have FORMER_E.
FORMER = (1, 2)
# Name in an answer of schema 3, which is otherwise the same.
_FORMER_SPEEDS = "speeds_m_s"
TABLES = ("restitution", "loops", "scores", "trains", "rests")
# Conditions under which a setting ran in its scene.
CONDITIONS = keys(records.CONDITIONS)
# Names a setting at a step for an α.
RUN_KEY = keys(RUN)
IMPACT_COLUMNS = keys((*RUN, *STUDY_IMPACT))
TRAIN_COLUMNS = keys((*RUN, *BOUNCE))
REST_COLUMNS = keys((*RUN, *LAID))
LOOP_COLUMNS = keys((*RUN, SPEED, PHASE, *LOOP))

# Values of RUN_KEY.
Key: TypeAlias = tuple[Any, ...]


def run_key(scene: Scene, setting: Setting, alpha: float) -> dict[str, Any]:
    """The values of RUN_KEY."""
    place = (scene.name, scene.gravity, scene.off_axis, scene.friction)
    values = (*place, setting.engine, setting.name, alpha, setting.timestep)
    return dict(zip(RUN_KEY, values, strict=True))


def _none(columns: list[str]) -> pd.DataFrame:
    """A table without rows."""
    # Imported here: sweeps and worker processes need no pandas.
    import pandas as pd

    return pd.DataFrame(columns=columns)


class ImpactTable:
    """Impacts by setting, α and step, of which only so much is in memory as pages show."""

    def __init__(
        self,
        folded: Mapping[Key, Folded],
        read: Callable[[Collection[Key]], Iterable[pd.DataFrame]],
    ) -> None:
        """Results that are read when they are needed.

        folded: in the study's order.
        read: rows of some keys in that order, in pieces.
        """
        self.folded, self._read = folded, read

    @classmethod
    def of(cls, rows: pd.DataFrame, study: Mapping[str, Any]) -> ImpactTable:
        """The table of impacts that are in memory anyway."""
        if rows.empty:
            return cls({}, _InMemory({(): rows}))
        groups = dict(iter(rows.groupby(RUN_KEY, sort=False)))
        folded = {}
        for key, group in groups.items():
            folder = Folder(study)
            names = (*FOLDED, *FOLDED_OBLIQUE)
            folder.add({name: group[name].to_numpy() for name in names if name in group})
            folded[key] = folder.folded()
        return cls(folded, _InMemory(groups))

    def __len__(self) -> int:
        return sum(map(len, self.folded.values()))

    @cached_property
    def frame(self) -> pd.DataFrame:
        """All impacts, one in each row."""
        return self.rows(self.folded)

    def rows(self, keys: Collection[Key]) -> pd.DataFrame:
        """Rows of some keys."""
        import pandas as pd

        return pd.concat(list(self._read(keys)), ignore_index=True)

    def pieces(self) -> Iterator[pd.DataFrame]:
        """All rows, some at a time."""
        yield from self._read(self.folded)

    def only(self, keys: Collection[Key]) -> ImpactTable:
        """The table of some keys."""
        return ImpactTable(
            {key: one for key, one in self.folded.items() if key in keys}, self._read
        )

    def without_rows(self) -> ImpactTable:
        """The table without its rows, which is small to send."""
        return ImpactTable(self.folded, _no_rows)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the table with all rows: their files may be gone when it is read."""
        read = self._read
        if read is not _no_rows:
            read = _InMemory({key: self.rows([key]) for key in self.folded})
        return ImpactTable, (self.folded, read)


def _no_rows(_: Collection[Key]) -> Iterable[pd.DataFrame]:
    return []


@dataclass(frozen=True, slots=True)
class _InMemory:
    tables: Mapping[Key, pd.DataFrame]

    def __call__(self, keys: Collection[Key]) -> Iterable[pd.DataFrame]:
        """Tables of some keys; all of them where there is none."""
        return (self.tables[key] for key in keys or self.tables)


@dataclass(frozen=True, repr=False)
class Results(Drawn):
    """Everything a report or a check reads.

    study: the study file's content with its defaults filled in.
    settings: one record a run key.
    versions: package -> version.
    impacts, loops, scores: tables, columns as above.
    answers: what `tune` says of the study's conditions, where that is known without a search, see
    `usual_answers`.
    """

    study: Mapping[str, Any]
    settings: Sequence[Mapping[str, Any]]
    versions: Mapping[str, str]
    table: ImpactTable
    loops: pd.DataFrame
    scores: pd.DataFrame
    trains: pd.DataFrame = field(default_factory=lambda: _none(TRAIN_COLUMNS))
    rests: pd.DataFrame = field(default_factory=lambda: _none(REST_COLUMNS))
    answers: Sequence[Mapping[str, Any]] = field(default=(), kw_only=True)

    @property
    def impacts(self) -> pd.DataFrame:
        """All impacts, one in each row, read when they are first asked for."""
        return self.table.frame

    def _lines(self) -> Iterator[str]:
        """Lines for a terminal: title, counts, versions, and the tables there are."""
        yield str(self.study["title"])
        yield f"{len(self.table)} impacts, {len(self.settings)} settings"
        yield ", ".join(f"{name} {version}" for name, version in self.versions.items())
        yield "tables: .impacts, .loops, .scores, .trains, .rests"

    def to_frame(self) -> pd.DataFrame:
        """The scores: a row a setting, α and step, SI."""
        return self.scores.copy()

    def summary(self) -> dict[str, Any]:
        """The part that is not a table, JSON-able."""
        return {
            "schema": SCHEMA,
            "kind": "hcbench results",
            "study": self.study,
            "versions": self.versions,
            "settings": list(self.settings),
            "answers": list(self.answers),
            "impacts": len(self.table),
            "scores": json.loads(self.scores.to_json(orient="records", double_precision=15)),
        }

    def write(self, folder: Path) -> None:
        """Write the files into an existing folder."""
        tables = ([self.loops], [self.scores], [self.trains], [self.rests])
        for name, pieces in zip(TABLES, (self.table.pieces(), *tables), strict=True):
            write_bytes(folder / f"{name}.csv", _csv(pieces))
        write_text(folder / "summary.json", json_text(self.summary()))

    @classmethod
    def read(cls, folder: str | Path) -> Results:
        """Read what `write` wrote, in this schema; UserError for another folder.

        folder: written by `hcbench report`.
        """
        if not isinstance(folder, str | Path):
            raise UserError("folder", f"{folder!r:.80}", "a path")
        folder = Path(folder)
        try:
            summary = parse_json(read_text(folder / "summary.json"))
            schema = None
            if isinstance(summary, dict):
                schema = summary.get("schema")
            if schema not in (SCHEMA, SCHEMA - 1):
                got = f"{folder} has schema {schema!r}"
                if schema in FORMER:
                    got += f", {FORMER_E}"
                advice = "Run the study again with this version of hcbench"
                raise UserError("results", got, f"schema {SCHEMA}", advice)
            impacts, *tables = (read_table(folder / f"{name}.csv") for name in TABLES)
        except (OSError, ValueError) as error:
            raise UserError(
                "results", f"{folder}: {error}", "a folder that `hcbench report` wrote"
            ) from None
        validate(ResultTable, summary, UserError, f"{folder}/summary.json: {{}}")
        made = summary["study"], summary["settings"], summary["versions"]
        table = ImpactTable.of(impacts, summary["study"])
        return cls(*made, table, *tables, answers=_answers(summary))


def _answers(summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The answers of a summary with the keys of this schema."""
    answers: list[dict[str, Any]] = summary.get("answers", [])
    for choice in (choice for answer in answers for choice in answer["choices"]):
        if _FORMER_SPEEDS in choice:
            choice["speeds_m_per_s"] = choice.pop(_FORMER_SPEEDS)
    return answers


def read_table(path: Path) -> pd.DataFrame:
    """A table of a results folder, each number with its last digit."""
    import pandas as pd

    # A device, or a link to one, has no end.
    if path.exists() and not path.is_file():
        raise OSError(f"{path.name} is not a regular file")
    # Before version 3 pandas reads the last digit right only with this option; since then only
    # without it.
    exact: dict[str, Any] = (
        {} if int(pd.__version__.split(".")[0]) >= 3 else {"float_precision": "round_trip"}
    )
    # An empty number is NaN, but an empty reason is an empty text and
    # an empty claim "not resolved".
    table: pd.DataFrame = pd.read_csv(
        path, dtype=dict.fromkeys(["reason", *CLAIMS], "object"), **exact
    )
    if "reason" in table:
        table["reason"] = table["reason"].fillna("")
    for claim in CLAIMS:
        if claim in table:
            table[claim] = table[claim].map({"True": True, "False": False}).astype("object")
            table.loc[table[claim].isna(), claim] = None
    return table


def _csv(pieces: Iterable[pd.DataFrame]) -> Iterator[bytes]:
    """CSV with every float in the fewest digits that read back the same."""
    for i, piece in enumerate(pieces):
        text: str = piece.to_csv(index=False, lineterminator="\n", header=not i)
        yield text.encode()
