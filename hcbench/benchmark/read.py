"""Reads the results of a study out of a store: tables, scores, versions."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hcbench import scoring
from hcbench.benchmark.batch import MEASURED
from hcbench.benchmark.bounce_sequence import RESTS
from hcbench.benchmark.results import (
    FOLDED,
    FOLDED_OBLIQUE,
    LOOP_COLUMNS,
    REST_COLUMNS,
    RUN_KEY,
    Folded,
    Folder,
    ImpactTable,
    Key,
    Results,
    to_digits,
)
from hcbench.benchmark.store import DESCRIPTION, Store, open_files
from hcbench.benchmark.tables import columns_in, frame, frame_of, metadata_in, metadata_of
from hcbench.laws.force import HuntCrossley
from hcbench.system.errors import UserError
from hcbench.terms.impact import LOOP_TOLERANCE, Impact, Launch, Loop, Status
from hcbench.terms.records import LOOP, REASON, keys
from hcbench.tuning.usual import usual_answers

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    import pandas as pd

# Scores and folds the impacts of a setting, shard by shard, in a worker process: no table of all
# is made.

# Impacts of a setting, α and step that are folded at once; fewer if speeds are cut.
_PIECE = 16_384
_READ = {*FOLDED, *FOLDED_OBLIQUE, *keys(MEASURED), REASON.key}
_Columns = dict[str, NDArray[Any]]
# Speed, m/s, and phase of a launch.
_Launched = tuple[float, float]


@dataclass(frozen=True, slots=True)
class Gathered:
    """Impacts of a setting, α and step, folded and scored.

    score: values of SCORE_FIELDS.
    loops: those kept, simplified, each with its launch speed, m/s, and phase; sorted by them.
    """

    key: Key
    folded: Folded
    score: tuple[Any, ...]
    loops: Sequence[tuple[_Launched, Loop]]


class ShardsOfSetting(NamedTuple):
    """The shards of one setting, as one argument, which `map` of a pool of processes hands over.

    study: as plain values, with defaults filled in, SI.
    shards: (number, file name) of each, in order.
    """

    store: Store
    study: Mapping[str, Any]
    shards: Sequence[tuple[int, str]]


def gather(job: ShardsOfSetting) -> list[Gathered]:
    """Fold the impacts of one setting's shards to curves, and score them: one result for each α.

    Raises UserError for a damaged shard, OutputError for one that cannot be read.
    """
    seen: dict[Key, _Gathering] = {}
    for number, name in job.shards:
        impacts, loops = job.store.tables(number, name)
        columns = columns_in(impacts, _READ)
        loops_by_alpha = _loops_in(loops)
        for key, rows in places_of(impacts).items():
            one = seen.setdefault(key, _Gathering(key, job.study))
            one.add(_rows(columns, rows), loops_by_alpha.get(one.alpha, {}))
    return [one.gathered() for one in seen.values()]


def places_of(impacts: bytes) -> dict[Key, slice]:
    """Rows of a shard's table that belong to each key, a setting at a time step for one α: such
    rows follow one another.

    impacts: bytes of the table, whose metadata have the number of rows of each key.
    """
    places = {}
    begin = 0
    _loops_digest, summaries = metadata_of(impacts)
    for summary in summaries:
        end = begin + summary["impacts"]
        key = tuple(summary[name] for name in RUN_KEY)
        places[key] = slice(begin, end)
        begin = end
    return places


def _loops_in(content: bytes) -> dict[float, dict[_Launched, Loop]]:
    """The loops of a shard: α (s/m) -> launch speed (m/s) and phase -> loop.

    content: bytes of the shard's file of loops; empty if it kept none.
    """
    if not content:
        return {}
    columns = columns_in(content, LOOP_COLUMNS)
    launch = np.array([columns[name] for name in ("alpha_s_per_m", "speed_m_per_s", "phase")])
    # The rows of one loop follow one another: a new one begins where any of the three changes.
    begins = np.flatnonzero(np.r_[True, (launch[:, 1:] != launch[:, :-1]).any(axis=0)])
    loops: dict[float, dict[_Launched, Loop]] = {}
    for begin, end in zip(begins, [*begins[1:], None], strict=True):
        alpha, speed, phase = launch[:, begin].tolist()
        loop = Loop(*(columns[field.key][begin:end] for field in LOOP))
        loops.setdefault(alpha, {})[speed, phase] = loop
    return loops


class _Gathering:
    """Folds and scores the impacts of one key, a setting at a step for an α, shard by shard.

    alpha: of the law to score against, s/m.
    """

    def __init__(self, key: Key, study: Mapping[str, Any]) -> None:
        """Begin without impacts, for one setting, step and α.

        key: these, values of RUN_KEY.
        study: as plain values, with defaults filled in, SI.
        """
        self._key = key
        self.alpha = float(key[RUN_KEY.index("alpha_s_per_m")])
        self._law = HuntCrossley(study["stiffness"], self.alpha, study["exponent"])
        self._mass = float(study["mass_kg"])
        # Speeds, m/s, at which loops are scored.
        self._scored = set(study["loop_speeds"])
        self._tally = scoring.Tally(self._law, self._mass)
        self._folder = Folder(study)
        # Impacts that wait until they are enough, and for the rest of their speed.
        self._waiting: list[_Columns] = []
        self._loops: dict[_Launched, Loop] = {}

    def add(self, columns: _Columns, loops: Mapping[_Launched, Loop]) -> None:
        """Add the impacts of a shard, in the order of their launches, and the loops of some.

        columns: arrays of shape (n,), SI.
        loops: by launch speed, m/s, and phase.
        Impacts wait until there are _PIECE of them, as folding few costs as much as many; those of
        the last place of the curve wait for the next shard, which may have more of them.
        """
        self._waiting.append(columns)
        for launch, loop in loops.items():
            self._loops[launch] = loop.simplified(LOOP_TOLERANCE)
        # Scored are the loops as they were recorded, not the simplified ones.
        for impact in self._looped(columns, loops):
            score = scoring.score_loop(impact, self._law, self._mass)
            if score is not None:
                self._tally.add_loops([score])
        waiting = sum(len(each["status"]) for each in self._waiting)
        if waiting >= _PIECE:
            whole = _joined(self._waiting)
            place = self._folder.place(whole["speed_m_per_s"])
            # The next shard may have more impacts of this place.
            is_last = place == place[-1]
            self._use(_rows(whole, ~is_last))
            self._waiting = [_rows(whole, is_last)]

    def _looped(self, columns: _Columns, loops: Mapping[_Launched, Loop]) -> Iterator[Impact]:
        """Impacts of the study's loop speeds along the normal, with their loops.

        columns: arrays of shape (n,), SI.
        loops: by launch speed, m/s, and phase.
        """
        speeds = columns["speed_m_per_s"]
        phases = columns["phase"]
        head_on = columns.get("angle_rad", np.zeros(len(speeds))) == 0.0
        for (speed, phase), loop in loops.items():
            if speed not in self._scored:
                continue
            is_launch = head_on & (speeds == speed) & (phases == phase)
            for i in np.flatnonzero(is_launch).tolist():
                measured: dict[str, Any] = {}
                for field in MEASURED:
                    measured[field.name] = float(columns[field.key][i])
                yield Impact(
                    launch=Launch(speed, phase),
                    status=Status(columns["status"][i]),
                    reason=columns["reason"][i],
                    samples=int(columns["samples"][i]),
                    loop=loop,
                    **measured,
                )

    def _use(self, columns: _Columns) -> None:
        """Score and fold impacts, with all phases of their speeds.

        columns: arrays of shape (n,), SI; n may be 0, which changes nothing.
        """
        if not len(columns["status"]):
            return
        status = columns["status"]
        e = columns["restitution"]
        speed = columns["speed_m_per_s"]
        angle = columns.get("angle_rad", np.zeros(len(e)))
        # One number for each pair of speed and angle: as complex numbers,
        # NumPy tells the pairs apart.
        _, launch = np.unique(speed + 1j * angle, return_inverse=True)
        measured = scoring.Measured(
            speed=speed,
            launch=launch,
            parted=status == Status.PARTED.value,
            rested=status == Status.RESTED.value,
            speed_in=columns["speed_in_m_per_s"],
            e=e,
            # Along the plate an oblique impact loses energy too, which e does not tell.
            energy_lost=np.where(angle == 0.0, 1.0 - e**2, np.nan),
            samples=columns["samples"],
            gained=any("energy" in reason for reason in set(columns["reason"].tolist())),
        )
        self._tally.add(measured)
        self._folder.add(columns)

    def gathered(self) -> Gathered:
        """Fold what still waits, and return the summary of all impacts; to be called once, after one
        `add` or more.
        """
        self._use(_joined(self._waiting))
        self._waiting = []
        return Gathered(
            key=self._key,
            folded=self._folder.folded(),
            score=dataclasses.astuple(self._tally.score()),
            loops=sorted(self._loops.items(), key=lambda launch_and_loop: launch_and_loop[0]),
        )


def _joined(parts: Sequence[_Columns]) -> _Columns:
    """Impacts of parts, one or more, as one."""
    joined = {}
    for name in parts[0]:
        joined[name] = np.concatenate([part[name] for part in parts])
    return joined


def _rows(columns: _Columns, which: slice | NDArray[np.bool_]) -> _Columns:
    """Some of the impacts."""
    return {name: values[which] for name, values in columns.items()}


_LAUNCH = ["speed_m_per_s", "phase"]
_SETTING = [name for name in RUN_KEY if name != "alpha_s_per_m"]
# Rows that are read at once.
_ROWS_AT_ONCE = 16_384


def is_sweep(folder: str | Path) -> bool:
    """Say whether a path is a sweep's folder."""
    return (Path(folder) / DESCRIPTION).is_file()


def read(folder: str | Path, mapper: Callable[..., Iterable[Any]] = map) -> Results:
    """The results of a finished sweep: for studies of a size that a page can show.

    folder: a path, or an URL that fsspec opens.
    mapper: scores settings, as `map` does; that of a pool scores them side by side.
    Raises UserError for a folder that holds no sweep, one that is not finished, or a part that is
    damaged; OutputError for one that cannot be read.
    """
    return results_in(Store(open_files(os.fspath(folder))), mapper)


def results_in(store: Store, mapper: Callable[..., Iterable[Any]] = map) -> Results:
    """Read a store in as much memory as its page takes: rows are read when they are asked for.

    mapper: scores settings, as `map` does; that of a pool scores them side by side.
    Raises UserError for a folder that holds no sweep, one that is not finished, or a part that is
    damaged; OutputError for one that cannot be read.
    """
    # Imported here: a sweep itself needs no pandas.
    import pandas as pd

    about = store.description()
    if about is None:
        raise UserError("folder", f"{store.where} holds no sweep", "what `hcbench sweep` wrote")
    study = about["study"]
    # (number, file name) of each, in order.
    shards = list(store.shards(about["parts"]).items())
    # By setting, for all α: values of _SETTING. A setting that was planned as several grids,
    # such as one of two bands of speeds, has the shards of all of them.
    shards_of = dict[Key, list[tuple[int, str]]]()
    for begin, end in itertools.pairwise(about["parts_of_settings"]):
        # The first shard names the setting of all.
        impacts, _ = store.tables(*shards[begin])
        any_key = next(iter(places_of(impacts)))
        shards_of.setdefault(_setting_of(any_key), []).extend(shards[begin:end])
    by_key: dict[Key, Gathered] = {}
    jobs = [ShardsOfSetting(store, study, of_setting) for of_setting in shards_of.values()]
    for all_alphas in mapper(gather, jobs):
        for gathered in all_alphas:
            by_key[gathered.key] = gathered
    # In the order of the sweep's description.
    in_order = []
    folded = {}
    scores = []
    for key in _keys(about):
        gathered = by_key[key]
        in_order.append(gathered)
        folded[gathered.key] = gathered.folded
        scores.append((*gathered.key, *gathered.score))
    results = Results(
        study=study,
        settings=about["settings"],
        versions=_versions(about["versions"]),
        table=ImpactTable(folded, _StoredRows(store, shards_of)),
        loops=_rounded(_loop_table(in_order)),
        scores=_rounded(pd.DataFrame(scores, columns=[*RUN_KEY, *scoring.SCORE_FIELDS])),
        answers=usual_answers(study, about["versions"]),
    )
    if study["train_height"] is None:
        return results
    trains, rests = _drops(store)
    return replace(results, trains=_rounded(trains), rests=_rounded(rests))


def _keys(about: Mapping[str, Any]) -> dict[Key, None]:
    """Keys of all settings, in the study's order, each once.

    about: description of the sweep.
    """
    keys: dict[Key, None] = {}
    for setting in about["settings"]:
        key = tuple(setting[name] for name in RUN_KEY)
        keys[key] = None
    return keys


@dataclass(frozen=True)
class _StoredRows:
    """Reads the rows of an `ImpactTable` out of a store.

    of_settings: their shards by _SETTING.
    """

    store: Store
    of_settings: Mapping[Key, Sequence[tuple[int, str]]]

    def __call__(self, keys: Collection[Key]) -> Iterator[pd.DataFrame]:
        """Rows of these keys, in their order, in tables of _ROWS_AT_ONCE rows or some more.

        Raises UserError for a damaged shard, OutputError for one that cannot be read.
        """
        # One entry for each α of a setting.
        decoded = lru_cache(maxsize=8)(self._decoded)
        pieces: list[dict[str, Any]] = []
        count = 0
        for key in keys:
            for shard in self.of_settings[_setting_of(key)]:
                columns, places = decoded(shard)
                if key in places:
                    rows = places[key]
                    pieces.append({name: values[rows] for name, values in columns.items()})
                    count += len(pieces[-1]["status"])
                if count >= _ROWS_AT_ONCE:
                    yield _rounded(frame_of(pieces))
                    pieces = []
                    count = 0
        if pieces:
            yield _rounded(frame_of(pieces))

    def _decoded(self, shard: tuple[int, str]) -> tuple[dict[str, Any], dict[Key, slice]]:
        """Columns of a shard, by name, and the rows of each key in them.

        shard: number and name.
        """
        content, _ = self.store.tables(*shard)
        return columns_in(content), places_of(content)


def _setting_of(key: Key) -> Key:
    """A key but for its α."""
    return tuple(value for name, value in zip(RUN_KEY, key, strict=True) if name in _SETTING)


def _rounded(table: pd.DataFrame) -> pd.DataFrame:
    """A table, of any columns, with measured numbers rounded by `to_digits` to those that every
    processor computes alike.
    """
    # What the study gives, and not a simulation, stays as it is.
    given = {*RUN_KEY, *_LAUNCH, "angle_rad"}
    rounded = {}
    for name, column in table.items():
        if name not in given and column.dtype == np.float64:
            rounded[str(name)] = to_digits(column.to_numpy())
    return table.assign(**rounded)


def _versions(versions: Mapping[str, str]) -> dict[str, str]:
    """{package or engine: version} that a page states: of what made the results, as the sweep has
    them, `versions`, and of what makes their page, of this process. Packages first, then engines;
    pyarrow is left out.
    """
    packages = ("hcbench", "matplotlib", "numpy", "scipy", "python")
    stated = dict(versions)
    stated["matplotlib"] = version("matplotlib")
    stated["python"] = platform.python_version()
    of_packages = {name: stated[name] for name in packages}
    engines = {name: text for name, text in versions.items() if name not in (*packages, "pyarrow")}
    return of_packages | engines


def _drops(store: Store) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Read the drops under gravity: a table of their bounces (TRAIN_COLUMNS), and one of how the
    bodies lie at the end (REST_COLUMNS), SI.

    Raises UserError where the store lacks them, OutputError where it cannot be read.
    """
    import pandas as pd

    table = store.bounces()
    if table is None:
        got = f"{store.where} holds no bounces under gravity, or they are damaged"
        raise UserError("folder", got, "a finished sweep", "Finish it by --resume")
    rests = json.loads(metadata_in(table).get(RESTS, b"[]"))
    return frame([table]), pd.DataFrame(rests, columns=REST_COLUMNS)


def _loop_table(results: Sequence[Gathered]) -> pd.DataFrame:
    """All kept loops, one below another, in LOOP_COLUMNS: a row for each step, SI.

    results: of settings, in the order of the table. Without any loop the table has no rows.
    """
    import pandas as pd

    # Of each loop: setting and launch, samples, and how many there are.
    keys = []
    loops = []
    lengths = []
    for result in results:
        for launch, loop in result.loops:
            keys.append((*result.key, *launch))
            loops.append(loop)
            lengths.append(len(loop.time))
    if not loops:
        return pd.DataFrame(columns=LOOP_COLUMNS)
    columns: list[Any] = []
    for values in zip(*keys, strict=True):
        repeated = pd.Series(values).repeat(lengths)
        columns.append(repeated.array)
    for name in ("time", "penetration", "rate", "force"):
        samples = [getattr(loop, name) for loop in loops]
        columns.append(np.concatenate(samples))
    return pd.DataFrame(dict(zip(LOOP_COLUMNS, columns, strict=True)))
