"""Tables as bytes: Parquet for the files of a sweep, NumPy's own format for what stays in memory.

Parquet needs pyarrow, which takes 170 MB of disk. Both read back as the same table.
"""

from __future__ import annotations

import io
import os
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.system.errors import CannotRun

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    import pandas as pd

    Encode = Callable[[Sequence[Mapping[str, Any]], Sequence[str], Mapping[str, bytes]], bytes]

_TEXTS = ("scene", "engine", "setting", "status", "reason")
_WHOLE = ("samples", "bounce")
# First bytes of a Parquet file.
_PARQUET = b"PAR1"
# Prefixes of the names of arrays that are not columns.
_ABOUT = "metadata:"
_WORDS = "texts:"


def require_parquet() -> None:
    """Raises CannotRun where pyarrow is not installed."""
    # find_spec does not import pyarrow, which takes memory: workers write the parts.
    if find_spec("pyarrow") is None:
        got = "pyarrow is not installed"
        advice = "Try: pip install pyarrow"
        raise CannotRun("sweep", got, "the package that writes Parquet", advice)


def arrays(
    tables: Sequence[Mapping[str, Any]], names: Sequence[str], metadata: Mapping[str, bytes]
) -> bytes:
    """Tables below one another, as NumPy's bytes. A column has values, or
    one text or float for all rows.

    names: of the columns that are written. metadata: kept beside them, by name.
    """
    content: dict[str, Any] = {}
    for key, text in metadata.items():
        content[_ABOUT + key] = np.frombuffer(text, np.uint8)
    lengths = list(map(_length, tables))
    for name in names:
        columns = [_filled(table[name], n) for table, n in zip(tables, lengths, strict=True)]
        # Without tables there are no rows, and nothing that could be joined.
        joined = np.empty(0)
        if columns:
            joined = np.concatenate(columns)
        if name in _TEXTS:
            content[_WORDS + name], content[name] = _by_number(joined, len(joined))
        elif name in _WHOLE:
            content[name] = joined.astype(np.int64)
        else:
            content[name] = joined.astype(np.float64)
    sink = io.BytesIO()
    np.savez(sink, **content)
    return sink.getvalue()


def _length(table: Mapping[str, Any]) -> int:
    return max(len(column) for column in table.values() if not isinstance(column, str | float))


def _filled(values: Any, length: int) -> Any:
    """A column as an array: its values, or the one text or float that stands for all of its rows."""
    if isinstance(values, str):
        return np.full(length, values, dtype=object)
    if isinstance(values, float):
        return np.full(length, values)
    return np.asarray(values)


def _by_number(texts: Any, length: int) -> tuple[Any, Any]:
    """Each text once, in the order in which they come, and the number of the text in each row.

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
    """Tables below one another, as the bytes of a Parquet file."""
    # Arrow's own pool keeps 10 MB of memory that is freed.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
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
    """Arrow's type of a column: texts by their numbers, whole numbers, or floats."""
    import pyarrow as pa

    if name in _TEXTS:
        return pa.dictionary(pa.int32(), pa.string())
    return pa.int64() if name in _WHOLE else pa.float64()


# Made from buffers: `pyarrow.array` loads pandas, which takes more memory than the rest of a sweep.
def _parquet_column(values: Any, length: int, kind: Any) -> Any:
    """A column of `length` values as an Arrow array; texts are stored once, with their numbers."""
    import pyarrow as pa

    if not pa.types.is_dictionary(kind):
        plain = np.ascontiguousarray(_filled(values, length), dtype=kind.to_pandas_dtype())
        return pa.Array.from_buffers(kind, len(plain), [None, pa.py_buffer(plain)])
    words, places = _by_number(values, length)
    texts = [text.encode() for text in words.tolist()]
    offsets = np.cumsum([0, *map(len, texts)], dtype=np.int32)
    once = pa.StringArray.from_buffers(
        len(texts), pa.py_buffer(offsets), pa.py_buffer(b"".join(texts))
    )
    numbers = pa.Array.from_buffers(pa.int32(), len(places), [None, pa.py_buffer(places)])
    return pa.DictionaryArray.from_arrays(numbers, once)


def metadata_in(content: bytes) -> dict[str, bytes]:
    """The metadata stored with a table of either kind.

    content: bytes of the file, whose first ones tell the kind.
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
    """The columns of a table of either kind as arrays, with texts as
    such; or those of some that it has.
    """
    if content.startswith(_PARQUET):
        return _parquet_columns(content, names)
    columns = {}
    with np.load(io.BytesIO(content), allow_pickle=False) as file:
        for name in file.files:
            is_column = not name.startswith((_ABOUT, _WORDS))
            if is_column and (names is None or name in names):
                columns[name] = _array_column(file, name)
    return columns


def _parquet_columns(content: bytes, names: Collection[str] | None) -> dict[str, Any]:
    """The columns of a Parquet file; or those of some names that it has."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    file = pq.ParquetFile(pa.BufferReader(content))
    wanted = [name for name in file.schema_arrow.names if names is None or name in names]
    table = file.read(wanted, use_threads=False)
    return {name: _parquet_values(table[name].combine_chunks()) for name in wanted}


def _array_column(file: Any, name: str) -> Any:
    """A column of NumPy's file, texts by their words: shape (n,)."""
    numbers_or_values = file[name]
    if name not in _TEXTS:
        return numbers_or_values
    return file[_WORDS + name].astype(object)[numbers_or_values]


def _parquet_values(column: Any) -> Any:
    """A column of Arrow's as an array, texts by their words: shape (n,)."""
    import pyarrow as pa

    if not pa.types.is_dictionary(column.type):
        return column.to_numpy(zero_copy_only=False)
    words = np.array(column.dictionary.to_pylist(), dtype=object)
    return words[column.indices.to_numpy(zero_copy_only=False)]


def frame(contents: Iterable[bytes]) -> pd.DataFrame:
    """Tables of one kind below one another, with texts as such."""
    return frame_of([columns_in(content) for content in contents])


def frame_of(tables: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Tables as `columns_in` reads them, one or more, below one another."""
    import pandas as pd

    joined = {}
    for name in tables[0]:
        joined[name] = np.concatenate([table[name] for table in tables])
    texts = [name for name in joined if name in _TEXTS]
    return pd.DataFrame(joined).astype(dict.fromkeys(texts, str))
