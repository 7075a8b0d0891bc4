"""Reads the results of a study out of a store: tables, scores, versions."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench import scoring
from hcbench.benchmark.batch import MEASURED
from hcbench.benchmark.bounce_sequence import RESTS
from hcbench.benchmark.encodings import frame, metadata_in
from hcbench.benchmark.files import open_files
from hcbench.benchmark.results import LOOP_COLUMNS, REST_COLUMNS, RUN_KEY, Results
from hcbench.benchmark.store import DESCRIPTION, Store
from hcbench.benchmark.tables import metadata_of
from hcbench.errors import UserError
from hcbench.impact import LOOP_TOLERANCE, Floats, Impact, Launch, Loop, Status
from hcbench.laws.force import HuntCrossley
from hcbench.tuning.usual import usual_answers

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    import pandas as pd

_LAUNCH = ["speed_m_per_s", "phase"]
_SETTING = [name for name in RUN_KEY if name != "alpha_s_per_m"]
_DIGITS, _DECIMALS, _LEAST = 10, 14, 1e-14  # of measured numbers
# By their exponents, negative ones from the end: the float nearest to each, which no processor may miss.
_POWERS = np.array([float(f"1e{k}") for k in (*range(_DECIMALS + 1), *range(-30, 0))])


def is_sweep(folder: str | Path) -> bool:
    """Whether a path is a sweep's folder."""
    return (Path(folder) / DESCRIPTION).is_file()


def read(folder: str | Path, mapper: Callable[..., Iterable[Any]] = map) -> Results:
    """The results of a finished sweep: for studies of a size that a page can show.

    mapper: as of `results_in`.
    Raises UserError for a folder that holds no sweep, one that is not finished, or a part that is damaged.
    """
    return results_in(Store(open_files(os.fspath(folder))), mapper)


def results_in(store: Store, mapper: Callable[..., Iterable[Any]] = map) -> Results:
    """The results of a finished sweep's store, in memory. Raises as `read`.

    mapper: scores settings, as `map` does; that of a pool scores them side by side.
    """
    import pandas as pd  # here, as a sweep itself needs none of it

    about = store.description()
    if about is None:
        raise UserError("folder", f"{store.where} holds no sweep", "what `hcbench sweep` wrote")
    study, shards = about["study"], dict[tuple[Any, ...], list[tuple[bytes, bytes]]]()
    for impacts, loops in store.tables(about["parts"]):
        key = next(iter(metadata_of(impacts)[1]))
        shards.setdefault(tuple(key[name] for name in _SETTING), []).append((impacts, loops))
    truth = _Truth(study["stiffness"], study["exponent"], study["mass_kg"], tuple(study["loop_speeds"]))
    scored = {one.key: one for some in mapper(partial(_score, truth), shards.values()) for one in some}
    keys = dict.fromkeys(tuple(setting[name] for name in RUN_KEY) for setting in about["settings"])
    results = [scored[key] for key in keys]
    return Results(
        study=study,
        settings=about["settings"],
        versions=_versions(about["versions"]),
        impacts=_rounded(pd.concat([one.impacts for one in results], ignore_index=True)),
        loops=_rounded(
            _loop_table([((*one.key, *launch), loop) for one in results for launch, loop in one.loops])
        ),
        scores=_rounded(
            pd.DataFrame([one.score for one in results], columns=[*RUN_KEY, *scoring.SCORE_FIELDS])
        ),
        **{name: _rounded(table) for name, table in _drops(store, study).items()},
        answers=usual_answers(study, about["versions"]),
    )


@dataclass(frozen=True, slots=True)
class _Truth:
    """What impacts are scored against: the law but for its α; the effective mass, kg.

    loop_speeds: of the loops that are scored, m/s.
    """

    stiffness: float
    exponent: float
    mass: float
    loop_speeds: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class _Scored:
    """A setting at one α and step: its impacts, its row of the scores, its kept loops by speed and phase."""

    key: tuple[Any, ...]
    impacts: pd.DataFrame
    score: tuple[Any, ...]
    loops: Sequence[tuple[Any, Loop]]


def _score(truth: _Truth, shards: Sequence[tuple[bytes, bytes]]) -> list[_Scored]:
    """Score the impacts of one setting and step, all its shards together, for each α."""
    samples = _by_key(loops for _, loops in shards if loops)
    results = []
    for key, impacts in _by_key(rows for rows, _ in shards).items():
        by_launch = samples[key].groupby(_LAUNCH) if key in samples else ()
        kept = {launch: _loop(table) for launch, table in by_launch}
        compared = {launch: loop for launch, loop in kept.items() if launch[0] in truth.loop_speeds}
        law = HuntCrossley(truth.stiffness, key[RUN_KEY.index("alpha_s_per_m")], truth.exponent)
        score = dataclasses.astuple(scoring.score(_impacts(impacts, compared), law, truth.mass))
        loops = [(launch, loop.simplified(LOOP_TOLERANCE)) for launch, loop in kept.items()]
        results.append(_Scored(key, impacts, (*key, *score), loops))
    return results


def _rounded(table: pd.DataFrame) -> pd.DataFrame:
    """A table with measured numbers cut to the digits that every processor computes alike."""
    given = {*RUN_KEY, *_LAUNCH, "angle_rad"}
    measured = {n: c.to_numpy() for n, c in table.items() if n not in given and c.dtype == np.float64}
    return table.assign(**{str(name): to_digits(values) for name, values in measured.items()})


def to_digits(values: Floats) -> Floats:
    """The values as files have them: to so many digits."""
    known = np.isfinite(values) & (np.abs(values) > _LEAST)
    size = np.floor(np.log10(np.abs(values), out=np.zeros_like(values), where=known)).astype(int)
    scale = _POWERS[np.minimum(_DIGITS - 1 - size, _DECIMALS)]
    small = np.where(np.isfinite(values), 0.0, values)
    return np.asarray(np.where(known, np.round(values * scale) / scale, small))


def _versions(versions: Mapping[str, str]) -> dict[str, str]:
    """Versions of what made the results, of the sweep, and of what makes their page, of this process."""
    here = {"matplotlib": version("matplotlib"), "python": platform.python_version()}
    packages = ("hcbench", "matplotlib", "numpy", "scipy", "python")
    engines = {name: text for name, text in versions.items() if name not in (*packages, "pyarrow")}
    return {**{name: {**versions, **here}[name] for name in packages}, **engines}


def _drops(store: Store, study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of drops under gravity."""
    import pandas as pd

    if study["train_height"] is None:
        return {}
    if (table := store.bounces()) is None:
        got = f"{store.where} holds no bounces under gravity, or they are damaged"
        raise UserError("folder", got, "a finished sweep", "Finish it by --resume")
    rests = json.loads(metadata_in(table).get(RESTS, b"[]"))
    return {"trains": frame([table]), "rests": pd.DataFrame(rests, columns=REST_COLUMNS)}


def _by_key(files: Iterable[bytes]) -> dict[tuple[Any, ...], pd.DataFrame]:
    """Tables of all files by the values of RUN_KEY, in the files' order."""
    contents = list(files)
    return dict(iter(frame(contents).groupby(RUN_KEY, sort=False))) if contents else {}


def _loop(table: pd.DataFrame) -> Loop:
    columns = (table[name].to_numpy() for name in ("time_s", "penetration_m", "rate_m_per_s", "force_n"))
    return Loop(*columns)


def _impacts(table: pd.DataFrame, kept: Mapping[Any, Loop]) -> list[Impact]:
    columns = {name: table[name].tolist() for name in table}
    angles = columns.get("angle_rad", [0.0] * len(table))
    measured = zip(*(columns[column] for column in MEASURED), strict=True)
    named = (columns[name] for name in ("status", "reason", "samples"))
    return [
        Impact(
            launch=Launch.at_angle(angle, *launch),
            status=Status(status),
            reason=reason,
            samples=samples,
            loop=None if angle else kept.get(launch),
            **dict(zip(MEASURED.values(), values, strict=True)),
        )
        for angle, launch, status, reason, samples, values in zip(
            angles, zip(*(columns[name] for name in _LAUNCH), strict=True), *named, measured, strict=True
        )
    ]


def _loop_table(loops: Sequence[tuple[tuple[Any, ...], Loop]]) -> pd.DataFrame:
    """LOOP_COLUMNS of loops, each with the columns before the samples' own."""
    import pandas as pd

    if not loops:
        return pd.DataFrame(columns=LOOP_COLUMNS)
    lengths = [len(loop.time) for _, loop in loops]
    own = (pd.Series(values).repeat(lengths).array for values in zip(*(key for key, _ in loops), strict=True))
    samples = zip(*((loop.time, loop.penetration, loop.rate, loop.force) for _, loop in loops), strict=True)
    columns = (*own, *map(np.concatenate, samples))
    return pd.DataFrame(dict(zip(LOOP_COLUMNS, columns, strict=True)))
