"""Reads the results of a study out of a store: tables, scores, versions."""

from __future__ import annotations

import dataclasses
import io
import json
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench import scoring
from hcbench.benchmark.batch import MEASURED
from hcbench.benchmark.bounce_sequence import RESTS
from hcbench.benchmark.files import open_files
from hcbench.benchmark.results import LOOP_COLUMNS, REST_COLUMNS, RUN_KEY, Results
from hcbench.benchmark.store import DESCRIPTION, Store
from hcbench.errors import UserError
from hcbench.impact import Impact, Launch, Loop, Status
from hcbench.laws.force import HuntCrossley

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import pandas as pd

_LAUNCH = ["speed_m_per_s", "phase"]
_LOOP_TOLERANCE = 2e-3  # of the largest force, depth and rate: what a figure can show of a loop


def is_sweep(folder: str | Path) -> bool:
    """Whether a path is a sweep's folder."""
    return (Path(folder) / DESCRIPTION).is_file()


def read(folder: str | Path) -> Results:
    """The results of a finished sweep: for studies of a size that a page can show.

    Raises UserError for a folder that holds no sweep, one that is not finished, or a part that is damaged.
    """
    return results_in(Store(open_files(os.fspath(folder))))


def results_in(store: Store) -> Results:
    """All that is in a store, in memory. Raises as `read`."""
    import pandas as pd  # here, as a sweep itself needs none of it

    about = store.description()
    if about is None:
        raise UserError("folder", f"{store.where} holds no sweep", "what `hcbench sweep` wrote")
    tables, study = list(store.tables(about["parts"])), about["study"]
    impacts = _by_key(rows for rows, _ in tables)
    samples = _by_key(loops for _, loops in tables if loops)
    keys = list(dict.fromkeys(tuple(setting[name] for name in RUN_KEY) for setting in about["settings"]))
    loops, scores = [], []
    for key in keys:
        by_launch = samples[key].groupby(_LAUNCH) if key in samples else ()
        kept = {launch: _loop(table) for launch, table in by_launch}
        scored = {launch: loop for launch, loop in kept.items() if launch[0] in study["loop_speeds"]}
        of_key = [_impact(row, scored) for row in impacts[key].itertuples(index=False)]
        law = HuntCrossley(study["stiffness"], key[RUN_KEY.index("alpha_s_per_m")], study["exponent"])
        scores.append((*key, *dataclasses.astuple(scoring.score(of_key, law, study["mass_kg"]))))
        loops += [_loop_table((*key, *launch), loop) for launch, loop in kept.items()]
    return Results(
        study=study,
        settings=about["settings"],
        versions=_versions(about["versions"]),
        impacts=pd.concat([impacts[key] for key in keys], ignore_index=True),
        loops=pd.concat(loops, ignore_index=True) if loops else pd.DataFrame(columns=LOOP_COLUMNS),
        scores=pd.DataFrame(scores, columns=[*RUN_KEY, *scoring.SCORE_FIELDS]),
        **_drops(store, study),
    )


def _versions(versions: Mapping[str, str]) -> dict[str, str]:
    """Of everything that makes a result what it is, and its page: those of the sweep and those of here."""
    here = {"matplotlib": version("matplotlib"), "python": platform.python_version()}
    packages = ("hcbench", "matplotlib", "numpy", "scipy", "python")
    engines = {name: text for name, text in versions.items() if name not in (*packages, "pyarrow")}
    return {**{name: {**versions, **here}[name] for name in packages}, **engines}


def _drops(store: Store, study: Mapping[str, Any]) -> dict[str, pd.DataFrame]:
    """The tables of drops under gravity."""
    import pandas as pd
    import pyarrow.parquet as pq

    if study["train_height"] is None:
        return {}
    if (table := store.bounces()) is None:
        got = f"{store.where} holds no bounces under gravity, or they are damaged"
        raise UserError("folder", got, "a finished sweep", "Finish it by --resume")
    rests = json.loads((pq.read_metadata(io.BytesIO(table)).metadata or {}).get(RESTS, b"[]"))
    return {"trains": _frame([table]), "rests": pd.DataFrame(rests, columns=REST_COLUMNS)}


def _frame(files: Iterable[bytes]) -> pd.DataFrame:
    """Tables below one another, with texts as such."""
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.concat_tables([pq.read_table(io.BytesIO(content)) for content in files]).to_pandas()
    texts = {name: str for name in table if isinstance(table[name].dtype, pd.CategoricalDtype)}
    frame: pd.DataFrame = table.astype(texts)
    return frame


def _by_key(files: Iterable[bytes]) -> dict[tuple[Any, ...], pd.DataFrame]:
    """Tables of all files by the values of RUN_KEY, in the files' order."""
    contents = list(files)
    return dict(iter(_frame(contents).groupby(RUN_KEY, sort=False))) if contents else {}


def _loop(table: pd.DataFrame) -> Loop:
    columns = (table[name].to_numpy() for name in ("time_s", "penetration_m", "rate_m_per_s", "force_n"))
    return Loop(*columns)


def _impact(row: Any, kept: Mapping[Any, Loop]) -> Impact:
    launch, angle = (row.speed_m_per_s, row.phase), getattr(row, "angle_rad", 0.0)
    return Impact(
        launch=Launch.at_angle(angle, *launch),
        status=Status(row.status),
        reason=row.reason,
        samples=row.samples,
        loop=None if angle else kept.get(launch),
        **{name: getattr(row, column) for column, name in MEASURED.items()},
    )


def _loop_table(key: tuple[Any, ...], whole: Loop) -> pd.DataFrame:
    """LOOP_COLUMNS of one impact, thinned to what a figure can show. key: the columns before the samples'."""
    import pandas as pd

    loop = whole.simplified(_LOOP_TOLERANCE)
    columns = (*key, loop.time, loop.penetration, loop.rate, loop.force)
    return pd.DataFrame(dict(zip(LOOP_COLUMNS, columns, strict=True)))
