"""A part's impacts as the bytes of Parquet files, and what a summary says of them."""

from __future__ import annotations

import hashlib
import io
import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hcbench.benchmark.results import IMPACT_COLUMNS, LOOP_COLUMNS, RUN_KEY
from hcbench.benchmark.run import impact_columns
from hcbench.impact import Status
from hcbench.laws.force import HuntCrossley

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from hcbench.benchmark.batch import Flown
    from hcbench.benchmark.shards import Part
    from hcbench.impact import Floats, Loop

_WORDS = ("scene", "engine", "setting", "status", "reason")
_KEPT = b"hcbench.loops"  # in a part's metadata: the digest of its loops, or nothing
_TOLD = b"hcbench.summary"  # and its share of the summary
SUMMARY = ("impacts", "parted", "rested", "failed", "max_error_law", "rms_error_law", "max_error_linear")
Share = dict[str, Any]


def _schema(columns: Iterable[str]) -> Any:
    words, kind = pa.dictionary(pa.int32(), pa.string()), {"samples": pa.int64()}
    return pa.schema([(c, words if c in _WORDS else kind.get(c, pa.float64())) for c in columns])


@dataclass(frozen=True, slots=True)
class PartBytes:
    """The files of a part. loops: of its kept loops, nothing where there are none."""

    number: int
    impacts: int
    rows: bytes
    loops: bytes
    shares: Sequence[Share]


def digest(content: bytes) -> str:
    """What a file's name says of its content."""
    return hashlib.sha256(content).hexdigest()[:16]


def part_bytes(part: Part, flown: Sequence[Flown]) -> PartBytes:
    """The files of a part from its stretches: the same impacts give the same bytes."""
    told = {name: np.concatenate([own.columns[name] for own in flown]) for name in flown[0].columns}
    rows, loops, shares = [], [], []
    for alpha in part.alphas:
        key = (part.scene.name, part.setting.engine, part.setting.name, alpha, part.setting.timestep)
        law = HuntCrossley(part.scene.stiffness, alpha, part.scene.exponent)
        columns = impact_columns(key, told, law)
        rows.append(columns)
        loops += [_loop(key, part.launches[i], loop) for own in flown for i, loop in own.loops]
        shares.append({**dict(zip(RUN_KEY, key, strict=True)), **_share(columns)})
    kept = _parquet(loops, LOOP_COLUMNS, {}) if loops else b""
    also = {_KEPT: digest(kept).encode() if kept else b"", _TOLD: json.dumps(shares).encode()}
    return PartBytes(part.number, len(part.launches), _parquet(rows, IMPACT_COLUMNS, also), kept, shares)


def _loop(key: tuple[Any, ...], launch: tuple[float, float], loop: Loop) -> dict[str, Any]:
    columns = (*key, *launch, loop.time, loop.penetration, loop.rate, loop.force)
    return dict(zip(LOOP_COLUMNS, columns, strict=True))


def _parquet(tables: Sequence[Mapping[str, Any]], names: Sequence[str], told: Mapping[bytes, bytes]) -> bytes:
    schema = _schema(names)
    found = pa.concat_tables([_table(table, schema) for table in tables]).combine_chunks()
    sink = io.BytesIO()
    pq.write_table(found.replace_schema_metadata(told or None), sink, compression="zstd")
    return sink.getvalue()


def _table(columns: Mapping[str, Any], schema: Any) -> Any:
    length = max(len(c) for c in columns.values() if not isinstance(c, str | float))
    arrays = []
    for field in schema:
        values = columns[field.name]
        if field.name in _WORDS:
            arrays.append(_words([values] * length if isinstance(values, str) else values))
        else:
            numbers = np.full(length, values) if isinstance(values, float) else values
            arrays.append(_numbers(numbers, field.type))
    return pa.Table.from_arrays(arrays, schema=schema)


# From buffers: `pyarrow.array` loads pandas, which takes more memory than all else that a sweep is.
def _numbers(values: Any, kind: Any) -> Any:
    plain = np.ascontiguousarray(values, dtype=kind.to_pandas_dtype())
    return pa.Array.from_buffers(kind, len(plain), [None, pa.py_buffer(plain)])


def _words(values: Sequence[Any]) -> Any:
    """Each word once, in the order in which they come, and which one is where."""
    known: dict[str, int] = {}
    places = [known.setdefault(str(word), len(known)) for word in values]
    texts = [word.encode() for word in known]
    offsets = np.cumsum([0, *map(len, texts)], dtype=np.int32)
    once = pa.StringArray.from_buffers(len(texts), pa.py_buffer(offsets), pa.py_buffer(b"".join(texts)))
    return pa.DictionaryArray.from_arrays(_numbers(places, pa.int32()), once)


def _share(columns: Mapping[str, Any]) -> Share:
    """What one part adds to its setting's line in the summary."""
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


def shares_of(rows: bytes) -> tuple[str, list[Share]]:
    """Of a part's bytes: the digest of its loops, "" for none, and its share of the summary."""
    told = pq.read_metadata(io.BytesIO(rows)).metadata
    shares: list[Share] = json.loads(told[_TOLD])
    return told[_KEPT].decode(), shares


def summed(shares: Iterable[Share]) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Summary lines by key, the same whatever the order of the shares: sums are rounded once."""
    by_key: dict[tuple[Any, ...], list[Share]] = {}
    for share in shares:
        by_key.setdefault(tuple(share[name] for name in RUN_KEY), []).append(share)
    lines = {}
    for key, own in by_key.items():
        counts = {
            name: sum(share[name] for share in own) for name in ("impacts", "parted", "rested", "failed")
        }
        good = counts["parted"] + counts["rested"]
        square = math.fsum(share["sum_square_error_law"] for share in own)
        lines[key] = {
            **counts,
            "max_error_law": max(share["max_error_law"] for share in own) if good else math.nan,
            "rms_error_law": math.sqrt(square / good) if good else math.nan,
            "max_error_linear": max(share["max_error_linear"] for share in own) if good else math.nan,
        }
    return lines
