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

# Key of a shard's metadata: the digest of its loops, or nothing.
_LOOPS = "hcbench.loops"
# Key of what a shard adds to the summary.
_SUMMARY = "hcbench.summary"
SUMMARY = (
    "impacts",
    "parted",
    "rested",
    "failed",
    "max_error_law",
    "rms_error_law",
    "max_error_linear",
)
_COUNTS = ("impacts", "parted", "rested", "failed")
_MOST = ("max_error_law", "max_error_linear")
_SQUARES = "sum_square_error_law"
# One over the smallest float: every float is a whole multiple of that, so sums of integers are
# exact.
_SMALLEST = 1 << 1074
# Summary of the impacts of a shard for one α.
Summary = dict[str, Any]


@dataclass(frozen=True, slots=True)
class ShardFiles:
    """The files of a shard.

    loops: of its kept loops, empty where there are none.
    """

    number: int
    impacts: bytes
    loops: bytes
    summaries: Sequence[Summary]


def digest(content: bytes) -> str:
    """The digest of a content, for the name of its file."""
    return hashlib.sha256(content).hexdigest()[:16]


def shard_files(shard: Shard, results: Sequence[BatchResult], encode: Encode) -> ShardFiles:
    """The files of a shard from its batches: the same impacts give the same bytes.

    encode: writes tables with the given columns and metadata. A shard without loops has no file of
    them.
    """
    measured = {}
    for name in results[0].columns:
        measured[name] = np.concatenate([result.columns[name] for result in results])
    speeds, phases = shard.grid.asked(shard.part)
    asked = {"speed_m_per_s": speeds, "phase": phases}
    kept_loops = _loops_of_all(results)
    tables = []
    loops = []
    summaries = []
    for alpha in shard.grid.alphas:
        key = run_key(shard.inputs.scene, shard.grid.setting, alpha)
        columns = {**key, **asked, **measured, **_laws(alpha, measured["speed_in_m_per_s"])}
        tables.append(columns)
        summaries.append({**key, **_summary(columns)})
        for i, loop in kept_loops:
            loops.append(_loop_columns(key, (float(speeds[i]), float(phases[i])), loop))
    loops_file = b""
    loops_digest = b""
    if loops:
        loops_file = encode(loops, LOOP_COLUMNS, {})
        loops_digest = digest(loops_file).encode()
    names = list(IMPACT_COLUMNS)
    if shard.oblique:
        names += OBLIQUE_COLUMNS
    metadata = {
        _LOOPS: loops_digest,
        _SUMMARY: json.dumps(summaries).encode(),
    }
    return ShardFiles(shard.number, encode(tables, names, metadata), loops_file, summaries)


def _loops_of_all(results: Sequence[BatchResult]) -> list[tuple[int, Loop]]:
    """Kept loops of all batches, each with the number of its impact in the shard."""
    loops = []
    begin = 0
    for result in results:
        loops += [(begin + number, loop) for number, loop in result.loops]
        begin += len(result.columns["status"])
    return loops


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
    parted = status == Status.PARTED
    rested = status == Status.RESTED
    good = parted | rested
    e = columns["restitution"][good]
    off_law = e - columns["restitution_law"][good]
    off_linear = e - columns["restitution_linear"][good]
    return {
        "impacts": len(status),
        "parted": int(parted.sum()),
        "rested": int(rested.sum()),
        "failed": int((~good).sum()),
        "max_error_law": _largest(off_law),
        "sum_square_error_law": math.fsum(off_law**2),
        "max_error_linear": _largest(off_linear),
    }


def _largest(values: Floats) -> float:
    return float(np.abs(values).max()) if len(values) else 0.0


# A shard is verified and then read: two calls with the same bytes.
@lru_cache(maxsize=1)
def metadata_of(impacts: bytes) -> tuple[str, list[Summary]]:
    """Metadata of a shard's table: the digest of its loops, "" for none, and its part of the
    summary.
    """
    metadata = metadata_in(impacts)
    summaries: list[Summary] = json.loads(metadata[_SUMMARY])
    return metadata[_LOOPS].decode(), summaries


class Totals:
    """The summary of all shards until now: the same for every order of
    them, as sums are rounded once.
    """

    def __init__(self) -> None:
        self._by_key: dict[tuple[Any, ...], Summary] = {}

    def add(self, summaries: Iterable[Summary]) -> None:
        """Add the summaries of a shard."""
        for summary in summaries:
            key = tuple(summary[name] for name in RUN_KEY)
            total = self._by_key.setdefault(key, _no_impacts())
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


def _no_impacts() -> Summary:
    return {**dict.fromkeys(_COUNTS, 0), **dict.fromkeys(_MOST, 0.0), _SQUARES: 0}


def _line(total: Summary) -> Summary:
    """A line of the summary; its errors are NaN where no impact has an e."""
    line = {name: total[name] for name in _COUNTS}
    good = line["parted"] + line["rested"]
    if not good:
        return {
            **line,
            "max_error_law": math.nan,
            "rms_error_law": math.nan,
            "max_error_linear": math.nan,
        }
    line["rms_error_law"] = math.sqrt(total[_SQUARES] / _SMALLEST / good)
    for name in _MOST:
        line[name] = total[name]
    return line
