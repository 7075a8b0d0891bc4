"""The tables of a shard, and what a summary says of its impacts."""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.benchmark.batch import OBLIQUE_COLUMNS
from hcbench.benchmark.results import IMPACT_COLUMNS, LOOP_COLUMNS, RUN_KEY, run_key
from hcbench.laws import closed_form
from hcbench.system.errors import CannotRun
from hcbench.terms.impact import Floats, Loop, Status

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from hcbench.benchmark.batch import BatchResult
    from hcbench.benchmark.plan import Shard

# Tables as bytes: Parquet for the files of a sweep, NumPy's own format for what stays in memory.
#
# Parquet needs pyarrow, which takes 170 MB of disk. Both read back as the same table.

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    import pandas as pd
    from numpy.typing import NDArray

    Encode = Callable[[Sequence[Mapping[str, Any]], Sequence[str], Mapping[str, bytes]], bytes]

_TEXTS = ("scene", "engine", "setting", "status", "reason")
_WHOLE = ("samples", "bounce", "row", "failed")
# First bytes of a Parquet file.
_PARQUET = b"PAR1"
# Names of the arrays of a table: its rows, with numbers in place of texts; the texts of each column,
# as JSON; and the prefix of those of its metadata.
_ROWS = "rows"
_WORDS = "texts"
_ABOUT = "metadata:"


def require_parquet() -> None:
    """Raises CannotRun where pyarrow is not installed."""
    # find_spec does not import pyarrow, which takes memory and time.
    if find_spec("pyarrow") is None:
        got = "pyarrow is not installed"
        advice = "Try: pip install pyarrow"
        raise CannotRun("sweep", got, "the package that writes Parquet", advice)


def load_parquet() -> None:
    """Import what `parquet` needs. Copies of this process share its memory, of 30 MB."""
    # Arrow's own pool keeps 10 MB of memory that is freed.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    import pyarrow.parquet  # noqa: F401


def arrays(
    tables: Sequence[Mapping[str, Any]], names: Sequence[str], metadata: Mapping[str, bytes]
) -> bytes:
    """Bytes of an .npz file with several tables, one below the other; `columns_in` and `metadata_in`
    read it.

    tables: columns by name. A column has values, all of one length, or one text or float that
    stands for all rows; at least one column has values.
    names: of the columns that are written; every table has them.
    metadata: texts kept with the columns, as bytes, by name.
    """
    lengths = list(map(_length, tables))
    texts: dict[str, list[str]] = {}
    columns: dict[str, Any] = {}
    for name in names:
        parts = [_filled(table[name], n) for table, n in zip(tables, lengths, strict=True)]
        # Without tables there are no rows, and nothing that could be joined.
        joined = np.empty(0)
        if parts:
            joined = np.concatenate(parts)
        if name in _TEXTS:
            words, columns[name] = _by_number(joined, len(joined))
            texts[name] = words.tolist()
        else:
            columns[name] = joined.astype(np.int64 if name in _WHOLE else np.float64)
    # One array for all columns: NumPy takes longer to find an array in a file than to read it.
    kinds = [(name, column.dtype) for name, column in columns.items()]
    rows = np.empty(sum(lengths), dtype=kinds)
    for name, column in columns.items():
        rows[name] = column
    content: dict[str, Any] = {_ROWS: rows, _WORDS: _as_bytes(json.dumps(texts).encode())}
    for key, about in metadata.items():
        content[_ABOUT + key] = _as_bytes(about)
    sink = io.BytesIO()
    np.savez(sink, **content)
    return sink.getvalue()


def _as_bytes(content: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(content, np.uint8)


def _length(table: Mapping[str, Any]) -> int:
    """Rows of a table, some of whose columns are one value for all rows."""
    return max(len(column) for column in table.values() if not isinstance(column, str | float))


def _filled(values: Any, length: int) -> Any:
    """A column as an array: its values, or the one text or float that stands for all of its rows."""
    if isinstance(values, str):
        return np.full(length, values, dtype=object)
    if isinstance(values, float):
        return np.full(length, values)
    return np.asarray(values)


def _by_number(texts: Any, length: int) -> tuple[Any, Any]:
    """Store repeated texts by number: each text once, in the order in which they come, (k,), and
    the index of each row's text in these, (length,).

    texts: one for each of `length` rows, or a single text for all.
    """
    if isinstance(texts, str):
        return np.array([texts], dtype=str), np.zeros(length, dtype=np.int32)
    values = np.asarray(texts).tolist()
    number_of = {text: number for number, text in enumerate(dict.fromkeys(values))}
    numbers = np.fromiter(map(number_of.__getitem__, values), np.int32, length)
    return np.array(list(number_of), dtype=str), numbers


def parquet(
    tables: Sequence[Mapping[str, Any]], names: Sequence[str], metadata: Mapping[str, bytes]
) -> bytes:
    """Bytes of a Parquet file with several tables, one below the other.

    tables: columns by name, values or one value for all rows.
    names: of the columns to write, in this order.
    metadata: bytes to keep in the file, by key. It needs pyarrow: callers make sure of it by
    `require_parquet`.
    """
    load_parquet()
    import pyarrow as pa
    import pyarrow.parquet as pq

    kinds = {name: _parquet_type(name) for name in names}
    schema = pa.schema(list(kinds.items()))
    rows = []
    for table in tables:
        length = _length(table)
        columns = [_parquet_column(table[name], length, kind) for name, kind in kinds.items()]
        rows.append(pa.Table.from_arrays(columns, schema=schema))
    sink = io.BytesIO()
    joined = pa.concat_tables(rows or [schema.empty_table()]).combine_chunks()
    pq.write_table(joined.replace_schema_metadata(metadata or None), sink, compression="zstd")
    return sink.getvalue()


def _parquet_type(name: str) -> Any:
    """Arrow's type of a column, by its name: texts by their numbers, whole numbers, or floats."""
    import pyarrow as pa

    if name in _TEXTS:
        return pa.dictionary(pa.int32(), pa.string())
    return pa.int64() if name in _WHOLE else pa.float64()


# Made from buffers: `pyarrow.array` loads pandas, which takes more memory than the rest of a sweep.
def _parquet_column(values: Any, length: int, kind: Any) -> Any:
    """A column as an Arrow array of type `kind`; in a column of texts each text is stored once, and
    its index in each row.

    values: `length` of them, or one text or float for all rows.
    """
    import pyarrow as pa

    if not pa.types.is_dictionary(kind):
        plain = np.ascontiguousarray(_filled(values, length), dtype=kind.to_pandas_dtype())
        return pa.Array.from_buffers(kind, len(plain), [None, pa.py_buffer(plain)])
    words, places = _by_number(values, length)
    texts = [text.encode() for text in words.tolist()]
    # Arrow keeps texts as one run of bytes, and where in it each begins, and the last one ends.
    offsets = np.cumsum([0, *map(len, texts)], dtype=np.int32)
    once = pa.StringArray.from_buffers(
        len(texts), pa.py_buffer(offsets), pa.py_buffer(b"".join(texts))
    )
    numbers = pa.Array.from_buffers(pa.int32(), len(places), [None, pa.py_buffer(places)])
    return pa.DictionaryArray.from_arrays(numbers, once)


def metadata_in(content: bytes) -> dict[str, bytes]:
    """The metadata stored with a table, by name.

    content: bytes that `parquet` or `arrays` made; the first ones tell which.
    """
    if content.startswith(_PARQUET):
        import pyarrow.parquet as pq

        metadata_of_file = pq.read_metadata(io.BytesIO(content)).metadata or {}
        return {key.decode(): text for key, text in metadata_of_file.items()}
    metadata = {}
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        for name in file.files:
            if name.startswith(_ABOUT):
                metadata[name.removeprefix(_ABOUT)] = file[name].tobytes()
    return metadata


def columns_in(content: bytes, names: Collection[str] | None = None) -> dict[str, Any]:
    """The columns of a table by name: arrays of shape (n,), texts as texts.

    content: bytes that `parquet` or `arrays` made; the first ones tell which.
    names: those to read; one that the table lacks is left out. None for all.
    """
    if content.startswith(_PARQUET):
        return _parquet_columns(content, names)
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        rows = file[_ROWS]
        texts = json.loads(file[_WORDS].tobytes())
    columns = {}
    for name in rows.dtype.names:
        if names is not None and name not in names:
            continue
        columns[name] = np.ascontiguousarray(rows[name])
        if name in texts:
            columns[name] = np.array(texts[name], dtype=object)[columns[name]]
    return columns


def _parquet_columns(content: bytes, names: Collection[str] | None) -> dict[str, Any]:
    """The columns of a Parquet file, arrays by name.

    content: bytes of the file.
    names: of the columns to read; None: all.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(pa.BufferReader(content))
    wanted = [name for name in file.schema_arrow.names if names is None or name in names]
    table = file.read(wanted, use_threads=False)
    return {name: _parquet_values(table[name].combine_chunks()) for name in wanted}


def _parquet_values(column: Any) -> Any:
    """A column of Arrow's as an array, shape (n,); numbers of texts become the texts."""
    import pyarrow as pa

    if not pa.types.is_dictionary(column.type):
        return column.to_numpy(zero_copy_only=False)
    words = np.array(column.dictionary.to_pylist(), dtype=object)
    return words[column.indices.to_numpy(zero_copy_only=False)]


def frame(contents: Iterable[bytes]) -> pd.DataFrame:
    """Tables of one kind below one another, with texts as such."""
    return frame_of([columns_in(content) for content in contents])


def frame_of(tables: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """A data frame of one or more tables, one below the other, with the columns of the first.

    tables: arrays by the name of their column.
    """
    import pandas as pd

    joined = {}
    for name in tables[0]:
        joined[name] = np.concatenate([table[name] for table in tables])
    texts = [name for name in joined if name in _TEXTS]
    return pd.DataFrame(joined).astype(dict.fromkeys(texts, str))


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

    number: of all shards of the study.
    impacts: bytes of the table of its impacts: all for the first α, then all for the next.
    loops: bytes of the table of its kept loops, empty where there are none.
    summaries: one for each α, in the same order; the metadata of `impacts` have them too.
    """

    number: int
    impacts: bytes
    loops: bytes
    summaries: Sequence[Summary]


def digest(content: bytes) -> str:
    """The digest of a content, for the name of its file."""
    return hashlib.sha256(content).hexdigest()[:16]


def shard_files(shard: Shard, results: Sequence[BatchResult], encode: Encode) -> ShardFiles:
    """Make the files of a shard from its batches: the table of impacts, a row for each impact and
    α, that of the loops that are kept, and the summary for each α.

    results: of all its launches, in order, one batch or more.
    encode: makes the bytes of a table, `parquet` or `arrays`. The file of loops is empty if none
    was kept. The same impacts give the same bytes.
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
    """Kept loops of all batches of a shard, each with the index of its impact in the shard.

    results: of the batches of one shard, in order.
    """
    loops = []
    begin = 0
    for result in results:
        loops += [(begin + number, loop) for number, loop in result.loops]
        begin += len(result.columns["status"])
    return loops


def _laws(alpha: float, speed: Floats) -> dict[str, Floats]:
    """Columns of the law's e and of 1 - α v at each impact speed; NaN where the speed is NaN.

    alpha: s/m.
    speed: m/s, (n,), as is each column. For an infinite speed the law's e is NaN.
    """
    touched = np.isfinite(speed)
    law = np.full(len(speed), np.nan)
    law[touched] = closed_form.restitution(alpha, speed[touched])
    return {"restitution_law": law, "restitution_linear": 1.0 - alpha * speed}


def _loop_columns(key: Mapping[str, Any], asked: tuple[float, float], loop: Loop) -> dict[str, Any]:
    columns = (*key.values(), *asked, loop.time, loop.penetration, loop.rate, loop.force)
    return dict(zip(LOOP_COLUMNS, columns, strict=True))


def _summary(columns: Mapping[str, Any]) -> Summary:
    """Summary of the impacts of one shard for one α: counts, and errors of e against the law and 1 -
    α v, of those that parted or came to rest; 0 where none did.

    columns: of the impacts, by the names in IMPACT_COLUMNS, (n,) each. Squares of errors are only
    summed, so that `Totals` can take one root over all shards.
    """
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
    """Read the metadata of a shard's table: the digest of its file of loops, "" for none, and the
    summary for each α.

    impacts: bytes of the table.
    Raises KeyError for a table that is not of a shard.
    """
    metadata = metadata_in(impacts)
    summaries: list[Summary] = json.loads(metadata[_SUMMARY])
    return metadata[_LOOPS].decode(), summaries


class Totals:
    """The summary of all shards until now: the same for every order of
    them, as sums are rounded once.
    """

    def __init__(self) -> None:
        # By the values of RUN_KEY.
        self._by_key: dict[tuple[Any, ...], Summary] = {}

    def add(self, summaries: Iterable[Summary]) -> None:
        """Add the summaries of a shard, one for each α, with the keys of RUN_KEY."""
        for summary in summaries:
            key = tuple(summary[name] for name in RUN_KEY)
            total = self._by_key.setdefault(key, _no_impacts())
            for name in _COUNTS:
                total[name] += summary[name]
            for name in _MOST:
                total[name] = max(total[name], summary[name])
            # Exact, so that no order of shards changes the sum: in whole multiples of the smallest
            # float. `below` is a power of two that divides _SMALLEST.
            above, below = float(summary[_SQUARES]).as_integer_ratio()
            total[_SQUARES] += above * (_SMALLEST // below)

    def lines(self) -> dict[tuple[Any, ...], Summary]:
        """The lines of the summary by their keys."""
        return {key: _line(total) for key, total in self._by_key.items()}


def _no_impacts() -> Summary:
    return {**dict.fromkeys(_COUNTS, 0), **dict.fromkeys(_MOST, 0.0), _SQUARES: 0}


def _line(total: Summary) -> Summary:
    """Line of the summary of one setting, α and step, by the names of SUMMARY; its errors are NaN
    where no impact has an e.

    total: counts, largest errors, and the sum of the squares of errors in whole multiples of the
    smallest float, which is exact.
    """
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
