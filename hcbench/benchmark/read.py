"""A sweep's folder as results, for reports: what a run of the same study would have found."""

from __future__ import annotations

import dataclasses
import io
import os
import platform
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hcbench import scoring
from hcbench.benchmark.folder import SWEEP, Folder
from hcbench.benchmark.results import LOOP_COLUMNS, RUN_KEY, Results
from hcbench.benchmark.run import loop_table
from hcbench.errors import UserError
from hcbench.impact import Impact, Launch, Loop, Status
from hcbench.laws.force import HuntCrossley

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import pandas as pd

_LAUNCH = ["speed_m_per_s", "phase"]


def is_sweep(folder: str | Path) -> bool:
    """Whether a path is a sweep's folder."""
    return (Path(folder) / SWEEP).is_file()


def read(folder: str | Path) -> Results:
    """All of a finished sweep, in memory: for studies of a size that a page can show.

    Raises UserError for a folder that holds no sweep, one that is not finished, or a part that is damaged.
    """
    import pandas as pd  # here, as a sweep itself needs none of it

    place = Folder(os.fspath(folder))
    told = place.description()
    if told is None:
        raise UserError("folder", f"{folder} holds no sweep", "what `hcbench sweep` wrote")
    if (there := len(place.parts(told["parts"]))) < told["parts"]:
        raise UserError(
            "folder",
            f"{folder} holds {there} of {told['parts']} parts",
            "a finished sweep",
            "Finish it by --resume",
        )
    pairs = list(place.tables(told["parts"]))
    impacts = _by_key(rows for rows, _ in pairs)
    loops = _by_key(loops for _, loops in pairs if loops)
    order = list(dict.fromkeys(tuple(setting[name] for name in RUN_KEY) for setting in told["settings"]))
    scores, thinned = [], []
    for key in order:
        kept = {launch: _loop(own) for launch, own in loops[key].groupby(_LAUNCH)} if key in loops else {}
        found = [_impact(row, kept) for row in impacts[key].itertuples(index=False)]
        law = HuntCrossley(
            told["study"]["stiffness"], key[RUN_KEY.index("alpha_s_per_m")], told["study"]["exponent"]
        )
        scores.append((*key, *dataclasses.astuple(scoring.score(found, law, told["study"]["mass_kg"]))))
        thinned += [loop_table(key, impact) for impact in found if impact.loop is not None]
    return Results(
        study=told["study"],
        settings=told["settings"],
        versions={
            **told["versions"],
            "matplotlib": version("matplotlib"),
            "python": platform.python_version(),
        },
        impacts=pd.concat([impacts[key] for key in order], ignore_index=True),
        loops=pd.concat(thinned, ignore_index=True) if thinned else pd.DataFrame(columns=LOOP_COLUMNS),
        scores=pd.DataFrame(scores, columns=[*RUN_KEY, *scoring.SCORE_FIELDS]),
    )


def _by_key(files: Iterable[bytes]) -> dict[tuple[Any, ...], pd.DataFrame]:
    """Tables of all files by the values of RUN_KEY, in the files' order."""
    import pandas as pd
    import pyarrow as pa
    import pyarrow.parquet as pq

    tables = [pq.read_table(io.BytesIO(content)) for content in files]
    if not tables:
        return {}
    table = pa.concat_tables(tables).to_pandas()
    words = {name: str for name in table if isinstance(table[name].dtype, pd.CategoricalDtype)}
    return dict(iter(table.astype(words).groupby(RUN_KEY, sort=False)))


def _loop(table: pd.DataFrame) -> Loop:
    columns = (table[name].to_numpy() for name in ("time_s", "penetration_m", "rate_m_per_s", "force_n"))
    return Loop(*columns)


def _impact(row: Any, kept: Mapping[Any, Loop]) -> Impact:
    launch = (row.speed_m_per_s, row.phase)
    return Impact(
        launch=Launch(*launch),
        status=Status(row.status),
        reason=row.reason,
        speed_in=row.speed_in_m_per_s,
        speed_out=row.speed_out_m_per_s,
        duration=row.duration_s,
        penetration_max=row.penetration_max_m,
        force_max=row.force_max_n,
        samples=row.samples,
        loop=kept.get(launch),
    )
