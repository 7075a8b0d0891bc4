"""Tables in JSON: records, columns, or names beside rows, at any depth, a table for each drop."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from hcbench.fitting.cells import with_plain_digits
from hcbench.fitting.column_names import (
    CHANGES,
    QUANTITY_OF,
    is_unit,
    meanings_of,
    plain_unit,
    role_of,
    split_header,
    tells_drops_apart,
)
from hcbench.system.errors import UserError
from hcbench.system.text import sanitized

# Numbers of a list that are a column of its own, at least.
_LEAST_LISTED = 4
_NO_VECTORS = frozenset({"height", "time", "interval"})
# Letters of a text that may name a quantity, at most.
_LONGEST_NAME = 60
# A row of cells.
Cells = tuple[str, ...]


class _JsonTable(NamedTuple):
    """A table in JSON.

    path: the keys that lead to it; of an entry of a list its number, from 1.
    about: (name, value) of the texts and numbers beside the table and what holds it.
    rows: the names of the columns, where there are names, and the cells.
    """

    path: Cells
    about: tuple[Cells, ...]
    rows: Sequence[Cells]


def tables_of_json(name: str, content: Any) -> list[tuple[str, list[Cells]]]:
    """The tables in JSON: what errors call each, and its rows of text, below the texts beside it.

    name: of the file.
    content: as `json.loads` gives it.
    Raises UserError where there is no table, and for tables of one header under names of balls.
    """
    tables = list(_tables(content, (), ()))
    if not tables:
        expected = 'records, or columns such as {"time [s]": [0.32, 0.61]}'
        raise UserError(name, "JSON without a table", expected)
    _require_drops(name, tables)
    found = []
    for path, about, rows in tables:
        called = name if len(tables) == 1 else f"{name}, {sanitized(' '.join(path))}"
        # An empty list or record gives no row.
        found.append((called, [row for row in (*about, *rows) if row]))
    return found


def _require_drops(name: str, tables: Sequence[_JsonTable]) -> None:
    """Raise UserError where tables alike stand under keys that may name balls, such as "steel"."""
    alike = [table.path for table in tables if table.rows[0] == tables[0].rows[0]]
    for keys in zip(*alike, strict=False):
        named = [key for key in dict.fromkeys(keys) if not tells_drops_apart(key)]
        if len(set(keys)) > 1 and named:
            got = f"tables alike under {', '.join(map(repr, named[:3]))}"
            advice = "Put each ball into a file of its own, or name drops 'drop 1', 'drop 2'"
            raise UserError(name, got, "drops of one ball", advice)


def _tables(content: Any, path: Cells, about: tuple[Cells, ...]) -> Iterator[_JsonTable]:
    """The tables in a part of JSON, in their order.

    path: the keys that lead to the part.
    about: (name, value) beside it.
    """
    if isinstance(content, list):
        yield from _tables_of_list(content, path, about)
    elif isinstance(content, dict):
        yield from _tables_of_record(content, path, about)


def _tables_of_list(
    content: list[Any], path: Cells, about: tuple[Cells, ...]
) -> Iterator[_JsonTable]:
    """Yield the tables in a list: of each entry that has some, as a drop has; else the list as one.

    path: the keys that lead to the list.
    about: (name, value) beside it.
    """
    is_of_data = bool(path) and _names_data(path[-1])
    has_drops = False
    for number, one in enumerate(content, 1):
        path_of_one = (*path, str(number))
        if _holds_tables(one):
            has_drops = True
            yield from _tables(one, path_of_one, about)
        elif is_of_data and _is_column(one):
            # {"heights_cm": [[81, 66, 53], [80, 65, 53]]}
            has_drops = True
            yield _JsonTable(path_of_one, about, _one_column(path[-1], one))
    rows = None if has_drops else _rows_of_list(content)
    if rows:
        yield _JsonTable(path, about, rows)


def _one_column(name: str, numbers: Sequence[Any]) -> list[Cells]:
    """The rows of a table of one column: its name, and a number each."""
    return [(name,), *((cell,) for cell in _texts(numbers))]


def _tables_of_record(
    content: dict[str, Any], path: Cells, about: tuple[Cells, ...]
) -> Iterator[_JsonTable]:
    """Yield the tables in a record: its lists as columns, and those of its other values.

    path: the keys that lead to the record.
    about: (name, value) beside it, to which its own texts and numbers are added.
    """
    if isinstance(content.get("columns"), list) and isinstance(content.get("data"), list):
        # As pandas writes it.
        yield _JsonTable(path, about, [_texts(content["columns"]), *map(_texts, content["data"])])
        return
    scalars = ((str(key), text_of_cell(one)) for key, one in content.items() if _is_scalar(one))
    about = (*about, *scalars)
    columns = _columns(content, path, about)
    if len(columns) > 1 and all(map(tells_drops_apart, columns)):
        # {"heights_cm": {"drop 1": [81, 66, 53], "drop 2": [80, 65, 53]}}
        for name, numbers in columns.items():
            header = _quantity_over(path, about) or name
            yield _JsonTable((*path, name), about, _one_column(header, numbers))
    elif columns:
        rows = itertools.zip_longest(*columns.values(), fillvalue="")
        yield _JsonTable(path, about, [tuple(columns), *map(_texts, rows)])
    for key, value in content.items():
        if _series(value) is None:
            yield from _tables(value, (*path, str(key)), about)


def _columns(
    content: Mapping[str, Any], path: Cells, about: Sequence[Cells]
) -> dict[str, list[Any]]:
    """The columns among the values of a record, by their names with units.

    path: the keys that lead to the record.
    about: (name, value) beside it.
    """
    columns = {}
    # {"apex": {"time_s": [...]}}
    over = "".join(f"{key} " for key in path if meanings_of(key) & CHANGES)
    for key, value in content.items():
        series = _series(value)
        if series is None:
            continue
        # {"heights_cm": [{"values": [...]}, ...]}
        name = key if meanings_of(key) else _quantity_over(path, about) or key
        header = f"{over}{name}"
        if series.unit:
            header = f"{header} [{series.unit}]"
        columns[header] = series.values
    # {"unit": "s", "times": [...]}: the unit of the only column.
    unit = next((text for key, text in about if key.lower() in ("unit", "units")), "")
    if len(columns) == 1 and unit:
        return {f"{header} [{unit}]": values for header, values in columns.items()}
    return columns


def _quantity_over(path: Cells, about: Sequence[Cells]) -> str:
    """The name of a quantity over a list: the nearest key that leads to it, or a text beside it, such
    as "rebound height"; "" for none.
    """
    texts = [text for _, text in about if len(text) < _LONGEST_NAME]
    return next(filter(_names_data, (*reversed(path), *reversed(texts))), "")


def _holds_tables(content: Any) -> bool:
    """Say whether a record has a table of its own, as that of a drop has: a list of records, or of
    numbers under the name of a quantity; three numbers or fewer may be a vector.
    """
    if not isinstance(content, dict):
        return False
    for key, value in content.items():
        if _are_records(value) or _holds_tables(value):
            return True
        meanings = meanings_of(str(key))
        # Three places are a vector in ROS; three heights or times are not.
        least = _LEAST_LISTED - 1 if meanings & _NO_VECTORS else _LEAST_LISTED
        may_be_data = not meanings or _names_data(key)
        if may_be_data and _is_column(value) and len(value) >= least:
            return True
    return False


def _is_column(value: Any) -> bool:
    """Say whether a value is a list of numbers and texts."""
    return isinstance(value, list) and bool(value) and all(map(_is_scalar, value))


def _are_records(value: Any) -> bool:
    """Say whether a value is a list of records."""
    return isinstance(value, list) and bool(value) and all(isinstance(one, dict) for one in value)


def _rows_of_list(content: list[Any]) -> list[Cells] | None:
    """Rows of records below their names, of lists, or of numbers alone; None for anything else."""
    if _are_records(content):
        flat = list(map(_flat, content))
        names = tuple(dict.fromkeys(itertools.chain.from_iterable(flat)))
        return [names, *(_texts([record.get(name) for name in names]) for record in flat)]
    if content and all(isinstance(one, list) for one in content):
        return list(map(_texts, content))
    if _is_column(content):
        return [(cell,) for cell in _texts(content)]
    return None


def _flat(record: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """A record with the names of nested ones joined by points, "pose.z", and places in lists, "v[2]".

    before: what stands before each name.
    """
    found: dict[str, Any] = {}
    for key, value in record.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{before}{key}.")
        elif isinstance(value, list):
            found |= {f"{before}{key}[{i}]": one for i, one in enumerate(value)}
        else:
            found[f"{before}{key}"] = value
    return found


class _Series(NamedTuple):
    """The numbers of a column, and their unit, "" where it is not stated beside them."""

    unit: str
    values: list[Any]


def _series(value: Any) -> _Series | None:
    """The column that a value is: a list, {"0": 81, "1": 66}, or {"unit": "cm", "values": [81, 66]};
    None for any other value.
    """
    if _is_column(value):
        return _Series("", value)
    if not isinstance(value, dict) or not value:
        return None
    if all(str(key).isdigit() for key in value) and all(map(_is_scalar, value.values())):
        # By the numbers of its rows, as pandas writes it.
        return _Series("", [value[key] for key in sorted(value, key=int)])
    if any(map(_names_data, value)):
        # {"drop 1": {"heights_cm": [...]}} is a table of its own.
        return None
    lists = [one for one in value.values() if isinstance(one, list)]
    if len(lists) != 1 or not all(map(_is_scalar, lists[0])):
        return None
    texts = (one for one in value.values() if isinstance(one, str))
    unit = next((one for one in texts if is_unit(plain_unit(one))), "")
    return _Series(unit, lists[0])


def _names_data(key: str) -> bool:
    """Say whether a key names a quantity that a column may have."""
    return role_of(*split_header(str(key))) in QUANTITY_OF


def _is_scalar(value: Any) -> bool:
    return value is None or isinstance(value, (str, int, float))


def text_of_cell(value: Any) -> str:
    """A value of JSON or of a workbook as a cell's text; "" for none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, float):
        return repr(float(value))
    return with_plain_digits(str(value))


def _texts(values: Sequence[Any]) -> Cells:
    return tuple(map(text_of_cell, values))
