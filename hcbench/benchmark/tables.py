"""The tables of a shard, and what a summary says of its impacts."""

from __future__ import annotations

import hashlib
import json
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.benchmark.batch import OBLIQUE_COLUMNS
from hcbench.benchmark.encodings import metadata_in
from hcbench.benchmark.results import IMPACT_COLUMNS, LOOP_COLUMNS, RUN_KEY, run_key
from hcbench.laws import closed_form
from hcbench.terms.impact import Floats, Loop, Status

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from hcbench.benchmark.batch import BatchResult
    from hcbench.benchmark.encodings import Encode
    from hcbench.benchmark.plan import Shard

_LOOPS = "hcbench.loops"  # in the metadata of a shard's table: the digest of its loops, or nothing
_SUMMARY = "hcbench.summary"  # and what it adds to the summary
SUMMARY = ("impacts", "parted", "rested", "failed", "max_error_law", "rms_error_law", "max_error_linear")
_COUNTS = ("impacts", "parted", "rested", "failed")
_MOST = ("max_error_law", "max_error_linear")
_SQUARES = "sum_square_error_law"
_SMALLEST = 1 << 1074  # one over the smallest float, of which each is a whole multiple
Summary = dict[str, Any]  # of the impacts of a shard for one α


@dataclass(frozen=True, slots=True)
class ShardFiles:
    """The files of a shard. loops: of its kept loops, empty where there are none."""

    number: int
    impacts: bytes
    loops: bytes
    summaries: Sequence[Summary]


def digest(content: bytes) -> str:
    """The digest of a content, for the name of its file."""
    return hashlib.sha256(content).hexdigest()[:16]


def shard_files(shard: Shard, results: Sequence[BatchResult], encode: Encode) -> ShardFiles:
    """The files of a shard from its batches: the same impacts give the same bytes."""
    measured = {name: np.concatenate([r.columns[name] for r in results]) for name in results[0].columns}
    speeds, phases = shard.grid.asked(shard.part)
    asked = {"speed_m_per_s": speeds, "phase": phases}
    starts = np.cumsum([0, *(len(result.columns["status"]) for result in results)]).tolist()
    kept = [(begin + i, loop) for begin, r in zip(starts, results, strict=False) for i, loop in r.loops]
    tables, loops, summaries = [], [], []
    for alpha in shard.grid.alphas:
        key = run_key(shard.inputs.scene, shard.grid.setting, alpha)
        columns = {**key, **asked, **measured, **_laws(alpha, measured["speed_in_m_per_s"])}
        tables.append(columns)
        loops += [_loop_columns(key, (float(speeds[i]), float(phases[i])), loop) for i, loop in kept]
        summaries.append({**key, **_summary(columns)})
    looped = encode(loops, LOOP_COLUMNS, {}) if loops else b""
    names = [*IMPACT_COLUMNS, *(OBLIQUE_COLUMNS if shard.oblique else ())]
    metadata = {_LOOPS: digest(looped).encode() if looped else b"", _SUMMARY: json.dumps(summaries).encode()}
    return ShardFiles(shard.number, encode(tables, names, metadata), looped, summaries)


def _laws(alpha: float, speed: Floats) -> dict[str, Floats]:
    """e of the law at each impact speed, NaN for none."""
    touched = np.isfinite(speed)
    law = np.full(len(speed), np.nan)
    law[touched] = closed_form.restitution(alpha, speed[touched])
    return {"restitution_law": law, "restitution_linear": 1.0 - alpha * speed}


def _loop_columns(key: Mapping[str, Any], asked: tuple[float, float], loop: Loop) -> dict[str, Any]:
    columns = (*key.values(), *asked, loop.time, loop.penetration, loop.rate, loop.force)
    return dict(zip(LOOP_COLUMNS, columns, strict=True))


def _summary(columns: Mapping[str, Any]) -> Summary:
    """Share of one shard in its setting's line of the summary."""
    status = np.asarray(columns["status"])
    good = (status == Status.PARTED) | (status == Status.RESTED)
    e = columns["restitution"][good]
    off_law, off_linear = e - columns["restitution_law"][good], e - columns["restitution_linear"][good]
    return {
        "impacts": len(status),
        "parted": int((status == Status.PARTED).sum()),
        "rested": int((status == Status.RESTED).sum()),
        "failed": int((~good).sum()),
        "max_error_law": _largest(off_law),
        "sum_square_error_law": math.fsum(off_law**2),
        "max_error_linear": _largest(off_linear),
    }


def _largest(values: Floats) -> float:
    return float(np.abs(values).max()) if len(values) else 0.0


@lru_cache(maxsize=1)  # a shard is verified, and then read
def metadata_of(impacts: bytes) -> tuple[str, list[Summary]]:
    """Metadata of a shard's table: the digest of its loops, "" for none, and its part of the
    summary.
    """
    metadata = metadata_in(impacts)
    summaries: list[Summary] = json.loads(metadata[_SUMMARY])
    return metadata[_LOOPS].decode(), summaries


class Totals:
    """The summary of all shards until now: the same for every order of them, as sums are rounded once."""

    def __init__(self) -> None:
        self._by_key: dict[tuple[Any, ...], Summary] = {}

    def add(self, summaries: Iterable[Summary]) -> None:
        """Add the summaries of a shard."""
        for summary in summaries:
            key = tuple(summary[name] for name in RUN_KEY)
            if (total := self._by_key.get(key)) is None:
                total = self._by_key[key] = {
                    **dict.fromkeys(_COUNTS, 0),
                    **dict.fromkeys(_MOST, 0.0),
                    _SQUARES: 0,
                }
            for name in _COUNTS:
                total[name] += summary[name]
            for name in _MOST:
                total[name] = max(total[name], summary[name])
            # Exact: whole multiples of the smallest float.
            above, below = float(summary[_SQUARES]).as_integer_ratio()
            total[_SQUARES] += above * (_SMALLEST // below)

    def lines(self) -> dict[tuple[Any, ...], Summary]:
        """The lines of the summary by their keys."""
        return {key: _line(total) for key, total in self._by_key.items()}


def _line(total: Summary) -> Summary:
    line = {name: total[name] for name in _COUNTS}
    if not (good := line["parted"] + line["rested"]):
        return {**line, "max_error_law": math.nan, "rms_error_law": math.nan, "max_error_linear": math.nan}
    rms = math.sqrt(total[_SQUARES] / _SMALLEST / good)
    return {**line, "rms_error_law": rms, **{name: total[name] for name in _MOST}}
