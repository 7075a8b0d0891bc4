"""Reads the results of a study out of a store: tables, scores, versions."""

from __future__ import annotations

import itertools
import json
import os
import platform
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench import scoring
from hcbench.benchmark.bounce_sequence import RESTS
from hcbench.benchmark.encodings import columns_in, frame, frame_of, metadata_in
from hcbench.benchmark.files import open_files
from hcbench.benchmark.fold import to_digits
from hcbench.benchmark.gather import Gathered, gather, places_of
from hcbench.benchmark.results import (
    LOOP_COLUMNS,
    REST_COLUMNS,
    RUN_KEY,
    ImpactTable,
    Key,
    Results,
)
from hcbench.benchmark.store import DESCRIPTION, Store
from hcbench.system.errors import UserError
from hcbench.tuning.usual import usual_answers

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

    import pandas as pd

_LAUNCH = ["speed_m_per_s", "phase"]
_SETTING = [name for name in RUN_KEY if name != "alpha_s_per_m"]
# Rows that are read at once.
_PIECE = 16_384


def is_sweep(folder: str | Path) -> bool:
    """Say whether a path is a sweep's folder."""
    return (Path(folder) / DESCRIPTION).is_file()


def read(folder: str | Path, mapper: Callable[..., Iterable[Any]] = map) -> Results:
    """The results of a finished sweep: for studies of a size that a page can show.

    mapper: as of `results_in`. Raises UserError for a folder that holds no sweep, one that is not
    finished, or a part that is damaged.
    """
    return results_in(Store(open_files(os.fspath(folder))), mapper)


def results_in(store: Store, mapper: Callable[..., Iterable[Any]] = map) -> Results:
    """Read a store in as much memory as its page takes: rows are read when they are asked for.

    mapper: scores settings, as `map` does; that of a pool scores them side by side. Raises
    UserError for a folder that holds no sweep, one that is not finished, or a part that is damaged.
    """
    # Imported here: a sweep itself needs no pandas.
    import pandas as pd

    about = store.description()
    if about is None:
        raise UserError("folder", f"{store.where} holds no sweep", "what `hcbench sweep` wrote")
    study = about["study"]
    shards = list(store.shards(about["parts"]).items())
    # Keys are those of _SETTING.
    shards_of = dict[Key, list[tuple[int, str]]]()
    for begin, end in itertools.pairwise(about["parts_of_settings"]):
        impacts, _ = store.tables(*shards[begin])
        any_key = next(iter(places_of(impacts)))
        shards_of.setdefault(_setting_of(any_key), []).extend(shards[begin:end])
    by_key: dict[Key, Gathered] = {}
    jobs = [(store, study, shards_of_setting) for shards_of_setting in shards_of.values()]
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
        """Rows of these keys, in tables of about _PIECE rows."""
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
                if count >= _PIECE:
                    yield _rounded(frame_of(pieces))
                    pieces = []
                    count = 0
        if pieces:
            yield _rounded(frame_of(pieces))

    def _decoded(self, shard: tuple[int, str]) -> tuple[dict[str, Any], dict[Key, slice]]:
        content, _ = self.store.tables(*shard)
        return columns_in(content), places_of(content)


def _setting_of(key: Key) -> Key:
    """A key but for its α."""
    return tuple(value for name, value in zip(RUN_KEY, key, strict=True) if name in _SETTING)


def _rounded(table: pd.DataFrame) -> pd.DataFrame:
    """A table with measured numbers cut to the digits that every processor computes alike."""
    given = {*RUN_KEY, *_LAUNCH, "angle_rad"}
    rounded = {}
    for name, column in table.items():
        if name not in given and column.dtype == np.float64:
            rounded[str(name)] = to_digits(column.to_numpy())
    return table.assign(**rounded)


def _versions(versions: Mapping[str, str]) -> dict[str, str]:
    """Versions of what made the results, of the sweep, and of what
    makes their page, of this process.
    """
    packages = ("hcbench", "matplotlib", "numpy", "scipy", "python")
    stated = dict(versions)
    stated["matplotlib"] = version("matplotlib")
    stated["python"] = platform.python_version()
    of_packages = {name: stated[name] for name in packages}
    engines = {name: text for name, text in versions.items() if name not in (*packages, "pyarrow")}
    return of_packages | engines


def _drops(store: Store) -> tuple[pd.DataFrame, pd.DataFrame]:
    """TRAIN_COLUMNS and REST_COLUMNS of the drops under gravity.
    UserError where the store lacks them.
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
