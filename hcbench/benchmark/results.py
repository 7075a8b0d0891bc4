"""The results of a study: tidy tables, the settings used, versions and provenance.

restitution.csv  one row an impact           loops.csv     one row a sample of a kept loop
scores.csv       one row a setting, α, step  trains.csv    one row a bounce of a drop under gravity
rests.csv        one row a drop: how the body lies at the end summary.json     schema (4; 1 and 2
have an earlier definition of e), study, settings, versions, answers hcbench-files.json: what of a
folder was written, so that the next time clears up after this one.
"""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hcbench.measuring.curve import Curve, CurvePoint, curve_of_columns
from hcbench.scoring import CLAIMS
from hcbench.system.errors import UserError
from hcbench.system.files import json_text, parse_json, read_text, write_bytes, write_text
from hcbench.system.text import Drawn
from hcbench.terms import records
from hcbench.terms.fields import ResultTable, validate
from hcbench.terms.impact import FORMER_E, Floats
from hcbench.terms.records import (
    ANGLE,
    BOUNCE,
    COULOMB,
    IMPULSE_RATIO,
    LAID,
    LAW,
    LOOP,
    PENETRATION_MAX,
    PHASE,
    RESTITUTION,
    RUN,
    SAMPLES,
    SLIP_IN,
    SPEED,
    SPEED_IN,
    STATUS,
    STUDY_IMPACT,
    keys,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator

    import pandas as pd

    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Setting

# Summary of one setting's impacts for pages, folded part by part, so that any number of them fits
# in memory.

# Columns of impacts that are folded, and those that only studies with oblique launches have.
FOLDED = keys((SPEED, PHASE, STATUS, SPEED_IN, RESTITUTION, LAW, PENETRATION_MAX, SAMPLES))
FOLDED_OBLIQUE = keys((ANGLE, SLIP_IN, IMPULSE_RATIO, COULOMB))
# Speeds of a curve; of more, one stands for its neighbours.
MOST_SPEEDS = 1000
# Significant digits of measured numbers in files.
_DIGITS = 10
# Decimals of measured numbers in files, at most.
_DECIMALS = 14
# Measured numbers below this are written as 0.
_LEAST = 1e-14
# Powers of ten by their exponent, negative ones from the end. Parsing gives the nearest float on
# every processor; computing may not.
_POWERS = np.array([float(f"1e{k}") for k in (*range(_DECIMALS + 1), *range(_DIGITS - 309, 0))])
_Columns = Mapping[str, NDArray[Any]]


@dataclass(frozen=True, slots=True)
class ShownLaunches:
    """One launch of each speed: in one phase, or the nearest to it that there is.

    restitution, speed_in, samples: e, impact speed in m/s and steps in contact, shape (n,), for n
    speeds. restitution is NaN for an impact without an e.
    """

    phase: float
    restitution: Floats
    speed_in: Floats
    samples: NDArray[np.int64]

    @classmethod
    def joined(cls, parts: Sequence[ShownLaunches]) -> ShownLaunches:
        """Launches of several parts of a curve, one part after another; at least one part."""
        return cls(
            parts[0].phase,
            np.concatenate([part.restitution for part in parts]),
            np.concatenate([part.speed_in for part in parts]),
            np.concatenate([part.samples for part in parts]),
        )


@dataclass(frozen=True, slots=True)
class Folded:
    """Impacts of one setting, α and step.

    status: how many ended so, in the order in which they came.
    angle: the smallest from the normal, rad, 0 as a rule; all that follows up to `at_step` is of
    launches at this angle.
    curve: e over launch speed against e of (16), speeds rising.
    of_loops, half_way: one launch of each speed of the curve: in the phase whose loops are kept,
    the later of two middle ones; and in the phase nearest to half-way through a step.
    at_step: the point of the study's step_speed; None where none was launched so.
    depth: the greatest, m.
    restitution: the least and the largest e.
    off: largest |e - e of (16)|.
    off_parted: of those that parted.
    rested: the fastest that came to rest, m/s.
    friction: largest difference between the ratio of impulses and Coulomb's; None where nothing
    slid.
    """

    status: Mapping[str, int]
    angle: float
    curve: Curve
    of_loops: ShownLaunches
    half_way: ShownLaunches
    at_step: CurvePoint | None
    depth: float
    restitution: tuple[float, float]
    off: float
    off_parted: float
    rested: float
    friction: float | None

    def __len__(self) -> int:
        return sum(self.status.values())


@dataclass(frozen=True, slots=True)
class _Part:
    """The curve of some speeds at one angle (rad), and what is shown of it."""

    angle: float
    curve: Curve
    of_loops: ShownLaunches
    half_way: ShownLaunches
    at_step: CurvePoint | None


class Folder:
    """Folds impacts of one setting, α and step into a `Folded`, all of a speed at once."""

    def __init__(self, study: Mapping[str, Any]) -> None:
        """Begin without impacts, for one study.

        study: as plain values, with defaults filled in, SI; its phases, speeds and step_speed
        count.
        """
        self._step_speed = float(study["step_speed"])
        # The phases are (k + 1/2) / phases: this is the later of the two middle ones.
        self._loop_phase = (study["phases"] // 2 + 0.5) / study["phases"]
        self._edges = _edges(study)
        # Number of impacts with each status.
        self._status = Counter[str]()
        # The largest of each so far; minus_e is -e, so that its largest is the least e.
        self._most = dict.fromkeys(
            ("depth", "e", "minus_e", "off", "off_parted", "rested", "friction"), math.nan
        )
        self._slid = False
        self._parts: list[_Part] = []

    def place(self, asked: Floats) -> NDArray[Any]:
        """A number for each speed, m/s, (n,): of speeds that share it one is shown."""
        return asked.round(12) if self._edges is None else np.searchsorted(self._edges, asked)

    def add(self, columns: _Columns) -> None:
        """Add the columns FOLDED of one impact or more, and FOLDED_OBLIQUE if the study has oblique
        launches.

        columns: arrays of shape (n,), SI, for all phases of their speeds: a speed whose phases come
        in two calls would be two points of the curve.
        """
        # Digits that every processor computes alike: a page must not depend on the others.
        e = to_digits(columns[RESTITUTION.key])
        # e of the law at each impact speed.
        law = to_digits(columns[LAW.key])
        speed_in = to_digits(columns[SPEED_IN.key])
        depth = to_digits(columns[PENETRATION_MAX.key])
        status = columns[STATUS.key]
        # Speeds of the study, m/s.
        asked = columns[SPEED.key]
        angle = columns.get(ANGLE.key, np.zeros(len(e)))
        self._status.update(status.tolist())
        off = np.abs(e - law)
        self._reach(depth=depth, e=e, off=off, off_parted=off[status == "parted"])
        self._reach(rested=asked[status == "rested"], minus_e=-e)
        if ANGLE.key in columns:
            slip = to_digits(columns[SLIP_IN.key])
            ratio = to_digits(columns[IMPULSE_RATIO.key])
            coulomb = to_digits(columns[COULOMB.key])
            self._slid |= bool((slip != 0).any())
            self._reach(friction=np.abs(ratio - coulomb))
        # Impacts at the smallest angle, 0 as a rule, make the curve.
        head_on = angle == angle.min()
        part = self._part(
            e=e[head_on],
            law=law[head_on],
            speed_in=speed_in[head_on],
            samples=columns[SAMPLES.key][head_on],
            phase=columns[PHASE.key][head_on],
            asked=asked[head_on],
            angle=angle[head_on],
        )
        self._parts.append(part)

    def _reach(self, **values: Floats) -> None:
        """Raise the largest values so far, by name, to those of some
        more impacts; NaN counts as none.
        """
        for name, some in values.items():
            self._most[name] = float(np.fmax.reduce(some, initial=self._most[name]))

    def _part(
        self,
        e: Floats,
        law: Floats,
        speed_in: Floats,
        samples: NDArray[np.int64],
        phase: Floats,
        asked: Floats,
        angle: Floats,
    ) -> _Part:
        """Fold n impacts of one angle: their curve of e over speed, and one launch of each speed.

        e, law: e of the impact, and of the law at its speed.
        speed_in, asked: impact speed and launch speed, m/s.
        samples: steps in contact.
        phase: where in a step the contact starts, 0 to 1.
        angle: rad, the same for all. Each is of shape (n,).
        """
        # Speeds that differ by round-off are one point.
        _, group = np.unique(asked.round(12), return_inverse=True)
        curve = curve_of_columns(
            group,
            speed=asked,
            angle=angle,
            phase=phase,
            speed_in=speed_in,
            restitution=e,
            target=law,
            samples=samples,
        )
        is_at_step = np.isclose(curve.speed, self._step_speed, rtol=1e-9)
        at_step = next(iter(curve.take(is_at_step)), None)
        # Numbers of the points that pages show.
        shown = self._one_for_neighbours(curve)

        def nearest_to(wanted: float) -> ShownLaunches:
            """Launches in the phase that is nearest to the wanted one, one of each shown speed; of
            two that are as near, in the earlier phase.
            """
            order = np.lexsort((phase, np.abs(phase - wanted), group))
            _, first_of_speed = np.unique(group[order], return_index=True)
            nearest = order[first_of_speed][shown]
            return ShownLaunches(wanted, e[nearest], speed_in[nearest], samples[nearest])

        middle_phase = min(np.unique(phase).tolist(), key=lambda p: abs(p - 0.5))
        return _Part(
            angle=float(angle.min()),
            curve=curve.take(shown),
            of_loops=nearest_to(self._loop_phase),
            half_way=nearest_to(middle_phase),
            at_step=at_step,
        )

    def _one_for_neighbours(self, curve: Curve) -> NDArray[np.int64]:
        """Indices of the points that are shown, shape (places,): of each place, the one with the
        largest error in one phase. A place is one speed, or in a study of very many speeds several
        neighbours.
        """
        place = self.place(curve.speed)
        worst_first = np.lexsort((-np.abs(curve.worst_phase), place))
        _, first_of_place = np.unique(place[worst_first], return_index=True)
        return worst_first[first_of_place]

    def folded(self) -> Folded:
        """Return the summary of all impacts that were added, with the curve of those at the smallest
        angle. Raises ValueError where none were added.
        """
        angle = min(part.angle for part in self._parts)
        curves = []
        of_loops = []
        half_way = []
        at_step = None
        for part in self._parts:
            # Parts at other angles have a curve of their own, which is not shown.
            if part.angle != angle:
                continue
            curves.append(part.curve)
            of_loops.append(part.of_loops)
            half_way.append(part.half_way)
            if at_step is None:
                at_step = part.at_step
        most = self._most
        friction = None
        if self._slid:
            friction = most["friction"]
        return Folded(
            status=dict(self._status),
            angle=angle,
            curve=Curve.joined(curves),
            of_loops=ShownLaunches.joined(of_loops),
            half_way=ShownLaunches.joined(half_way),
            at_step=at_step,
            depth=most["depth"],
            restitution=(-most["minus_e"], most["e"]),
            off=most["off"],
            off_parted=most["off_parted"],
            rested=most["rested"],
            friction=friction,
        )


def _edges(study: Mapping[str, Any]) -> Floats | None:
    """Speeds, m/s, (MOST_SPEEDS - 1,), that divide the band of a study into MOST_SPEEDS places of
    one width, the band's ends left out; None where no run has more speeds than that, and all are
    shown.

    study: as plain values, SI; its speeds and those of its runs count.
    """
    bands = [study["speeds"], *(run["speeds"] for run in study["runs"])]
    if max(map(len, bands)) <= MOST_SPEEDS:
        return None
    ends = min(map(min, bands)), max(map(max, bands))
    return np.linspace(*ends, MOST_SPEEDS + 1)[1:-1]


def to_digits(values: Floats) -> Floats:
    """Values of any shape, rounded to _DIGITS significant digits and at most _DECIMALS decimals, so
    that files have the same digits on every processor. Absolute values up to _LEAST become 0; NaN
    and infinity stay.
    """
    known = np.isfinite(values) & (np.abs(values) > _LEAST)
    # Power of ten of the first digit; 0 where there is none.
    logarithms = np.log10(np.abs(values), out=np.zeros_like(values), where=known)
    size = np.floor(logarithms).astype(int)
    decimals = np.minimum(_DIGITS - 1 - size, _DECIMALS)
    # Negative decimals of large numbers take their power from the end of the table.
    scale = _POWERS[decimals]
    small = np.where(np.isfinite(values), 0.0, values)
    return np.asarray(np.where(known, np.round(values * scale) / scale, small))


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
        """Keep the folded impacts, and a way to read the rows when they are needed.

        folded: by key (setting, α and step), in the study's order.
        read: rows of some keys, in that order, as data frames one after another.
        """
        self.folded = folded
        self._read = read

    @classmethod
    def of(cls, rows: pd.DataFrame, study: Mapping[str, Any]) -> ImpactTable:
        """The table of impacts that are in memory: folds them by setting, α and step.

        rows: one an impact, with IMPACT_COLUMNS, and FOLDED_OBLIQUE in a study with oblique
        launches.
        study: as plain values, with defaults filled in, SI.
        """
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
        """Tables of some keys; for no keys one table with all columns, and no rows."""
        if keys:
            return [self.tables[key] for key in keys]
        return [table.iloc[:0] for table in self.tables.values()]


@dataclass(frozen=True, repr=False)
class Results(Drawn):
    """Everything a report or a check reads.

    study: as `Study.described` gives it: the file's content with its defaults filled in, SI.
    settings: one record for each values of RUN_KEY, as `Plan.records`.
    versions: package or engine -> version.
    table: the impacts; `impacts` has them as one data frame, of IMPACT_COLUMNS.
    loops, trains, rests: of LOOP_COLUMNS, TRAIN_COLUMNS and REST_COLUMNS, SI.
    scores: a row for each values of RUN_KEY, with SCORE_FIELDS.
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
        """The content of summary.json: the study, what it was made with, and the scores."""
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
        """Write the files into an existing folder: a CSV file for each of TABLES, and summary.json.

        Raises UserError for a path at which no file can be, OutputError where it cannot be written.
        """
        tables = ([self.loops], [self.scores], [self.trains], [self.rests])
        for name, pieces in zip(TABLES, (self.table.pieces(), *tables), strict=True):
            write_bytes(folder / f"{name}.csv", _csv(pieces))
        write_text(folder / "summary.json", json_text(self.summary()))

    @classmethod
    def read(cls, folder: str | Path) -> Results:
        """Read the results of a folder that `write` wrote, in this schema or the one before.

        folder: its path.
        Raises UserError for anything else than a path, for results of another schema, and for a
        folder whose files are missing or have another form.
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
    """The answers of `tune` that a summary keeps, each a mapping with the keys of the present
    schema; keys of an older one are renamed in place.

    summary: content of a summary.json; one written before answers were kept has none.
    """
    answers: list[dict[str, Any]] = summary.get("answers", [])
    for answer in answers:
        for choice in answer["choices"]:
            if _FORMER_SPEEDS in choice:
                choice["speeds_m_per_s"] = choice.pop(_FORMER_SPEEDS)
    return answers


def read_table(path: Path) -> pd.DataFrame:
    """Read a CSV file that `Results.write` wrote as a data frame, each number exact to its last
    digit.

    An empty number is NaN, an empty reason "", and a claim True, False, or None for "not resolved".
    Raises OSError for a missing file and for what is not a regular file, ValueError for another
    form.
    """
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
