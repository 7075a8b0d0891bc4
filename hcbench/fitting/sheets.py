"""Files as sheets of cells: text in any encoding, workbooks, zip archives, documents and JSON."""

from __future__ import annotations

import html
import io
import re
import zipfile
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from hcbench.fitting.cells import with_plain_digits
from hcbench.fitting.column_names import (
    explained,
    is_short_latin,
    is_word_of_header,
)
from hcbench.fitting.json_tables import tables_of_json, text_of_cell
from hcbench.fitting.separators import Row, rows_of
from hcbench.system.errors import UserError
from hcbench.system.files import is_file, parse_json, read_bytes, require_small_archive
from hcbench.system.text import sanitized

if TYPE_CHECKING:
    from pathlib import Path

# Largest file that is read, bytes.
_LARGEST = 16 << 20
# Cells of a workbook's sheet, empty ones too; so many take some seconds.
_MOST_CELLS = 1_000_000
# The place of a cell in a sheet of .xlsx: <c r="AB12" s="1">.
_PLACE = re.compile(rb'<(?:\w+:)?c\b[^>]*?\br="([A-Z]{1,3})(\d{1,7})"')
# Share of bytes that are 0 from which on text has two bytes a letter.
_ZEROS = 0.3
_OLD_WORKBOOK = b"\xd0\xcf\x11\xe0"
_OF_WORD = "word/document.xml"
_ARCHIVE = b"PK\3\4"
# Encodings of text that is not in UTF: the first is taken where no word tells.
_ENCODINGS = (
    *("cp1252", "cp1250", "cp1251", "cp1253", "cp1254", "cp1255", "cp1256", "cp1257", "cp1258"),
    *("cp874", "cp932", "euc_jp", "gb18030", "big5", "cp949", "koi8_r", "cp866", "cp852"),
    *("cp850", "mac_roman"),
)
# Rows of SQL's INSERT in one line, and a column where the table is created.
_VALUES = re.compile(r"^\s*insert\s+into\b[^(;]*values\s*(.*);\s*$", re.IGNORECASE | re.MULTILINE)
_OF_SQL = re.compile(
    r"^\s*[`\"]?(\w+)[`\"]?\s+(?:\w*int|decimal|numeric|double|float|real)\b", re.I | re.M
)
# Rows, cells and ends of lines in HTML, and in documents of Word; all other tags.
_ROW = re.compile(r"(?is)<(?:w:)?tr\b.*?(?=<(?:w:)?tr\b|</(?:w:)?t(?:able|bl)\b|$)")
_CELL = re.compile(r"(?is)<(?:w:)?t[dhc]\b.*?(?=<(?:w:)?t[dhcr]\b|</(?:w:)?tr\b|$)")
_BREAK = re.compile(r"(?i)<(?:w:)?(?:/p|/div|br|/h\d|/li|/caption)\b[^>]*>")
_BARE = re.compile(r"<[^<>]*>")
# Lines from the first on that have the names of columns.
_HEADER_LINES = 60
# Files in an archive that hold tables.
_TABLES = (".csv", ".txt", ".tsv", ".dat", ".json")


@dataclass(frozen=True, slots=True)
class Sheet:
    """Rows of cells, with the names and units still among them.

    name: what errors call it: the file, and the sheet or the member where there are several.
    rows: number of each in the file, and its cells as text. In SQL and JSON the number is that of
    the row in its table; of a notebook, a page or a document, that of the line in its text.
    text: of the file, without the tags of HTML; of several tables in JSON the first has it. "" for
    workbooks, SQL and JSON Lines.
    """

    name: str
    rows: tuple[Row, ...]
    text: str = ""


def read_sheets(path: Path) -> list[Sheet]:
    """The sheets of a file: one of text, several of a workbook or an archive.

    Raises UserError, `explained`, for a file that cannot be read, without a table, or that is empty.
    """
    name = sanitized(path.name)
    with explained(name, ()):
        content = _content(path, name)
        sheets = _sheets(name, content, is_file(path))
        if not any(sheet.rows for sheet in sheets):
            raise UserError(name, "is empty", "a header and rows of numbers")
    return sheets


def _content(path: Path, name: str) -> bytes:
    """The bytes of a file. Raises UserError where it cannot be read."""
    try:
        # Read once: a pipe cannot be read again.
        return read_bytes(path, _LARGEST)
    except FileNotFoundError:
        raise UserError(str(path), "does not exist", "a file of measurements") from None
    except OSError as error:
        raise UserError(name, error.strerror or str(error), "a file that can be read") from None
    except ValueError as error:
        # A name with a null character, or a file beyond the largest.
        raise UserError(name, str(error), "a file that can be read") from None


def _sheets(name: str, content: bytes, is_on_disk: bool) -> list[Sheet]:
    """Sheets in the content of a file, by what it begins with."""
    if content.startswith(_OLD_WORKBOOK):
        return _of_workbook(name, content)
    if content.startswith(_ARCHIVE):
        return _of_archive(name, content)
    try:
        text = with_plain_digits(_of_mail(content) or decoded(content))
    except UnicodeDecodeError:
        expected = "text in columns, a workbook, or .wav"
        # A recording is read in parts, which no pipe gives.
        advice = "" if is_on_disk else "Save what the pipe brings to a file, and give that"
        raise UserError(name, "is neither text nor a WAV recording", expected, advice) from None
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise UserError(f"{name}, line {line}", "a null character", "text: letters and numbers")
    return _of_text(name, text)


def _of_mail(content: bytes) -> str:
    """The text of a mail whose letters are coded as "=C3=A9"; "" for other content."""
    if not re.search(rb"(?im)^content-transfer-encoding:\s*(?:quoted-printable|base64)", content):
        return ""
    # A tenth of the imports of a fit.
    from email import message_from_bytes
    from email.policy import default

    body = message_from_bytes(content, policy=default).get_body(("plain",))
    return body.get_content() if body is not None else ""


def decoded(raw: bytes) -> str:
    """Text in UTF-8, in UTF-16 with or without its mark, or in the encoding of a country in which
    most names of columns are known.

    Raises UnicodeDecodeError for what is not text.
    """
    if raw[:2] in (b"\xff\xfe", b"\xfe\xff"):
        text = raw.decode("utf-16")
        if any(letter.isdecimal() for letter in text):
            return text
    # Digits in UTF-16 without its mark: each second byte is 0.
    pairs = max(len(raw) // 2, 1)
    for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        if raw[first::2].count(0) > _ZEROS * pairs > raw[1 - first :: 2].count(0):
            text = raw.decode(encoding)
            if any(letter.isdecimal() for letter in text):
                return text
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        if any(byte < 9 for byte in raw):
            raise
        return max((raw.decode(one, errors="replace") for one in _ENCODINGS), key=_known_letters)


def _known_letters(text: str) -> tuple[int, int]:
    """Number of letters in words beyond ASCII that names of columns and units have, which a wrong
    encoding lacks: in words that tell, and in short Latin ones, which may come by chance.
    """
    words = set(re.findall(r"[^\W\d_]+", "\n".join(text.splitlines()[:_HEADER_LINES])))
    known = [word for word in words if not word.isascii() and is_word_of_header(word)]
    telling = [word for word in known if not is_short_latin(word)]
    return sum(map(len, telling)), sum(map(len, known))


def _of_text(name: str, text: str) -> list[Sheet]:
    """The sheets in a text: one for each table of JSON and of JSON Lines; else one, of a notebook of
    Jupyter, a page in HTML, a document of Word, rows in SQL, or lines of cells.

    Raises UserError for JSON that has no table, and for a damaged notebook.
    """
    begin = text.lstrip()[:1]
    if begin in ("{", "["):
        try:
            notebook = _of_notebook(name, parse_json(text))
            if notebook:
                return _of_text(name, notebook)
            return _of_json(name, parse_json(text), text)
        except ValueError:
            records = _of_json_lines(text)
            if records:
                return _of_json(name, records)
    if _CELL.search(text):
        text = _of_markup(text)
    rows = "),".join(_VALUES.findall(text))
    if rows.count("),") > 1 and _OF_SQL.search(text):
        listed = [one.strip("( )'") for one in re.split(r"\)\s*,", rows)]
        lines = [*enumerate([",".join(_OF_SQL.findall(text)), *listed], 1)]
        return [Sheet(name, rows_of(name, lines))]
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip()]
    return [Sheet(name, rows_of(name, lines), text)]


def _of_notebook(name: str, content: Any) -> str:
    """The text of a notebook of Jupyter, each cell with what it printed below; "" for other content.

    Raises UserError for a notebook whose cells are not those of Jupyter.
    """
    if not isinstance(content, dict) or not {"cells", "nbformat"} <= content.keys():
        return ""
    parts = []
    try:
        for cell in content["cells"]:
            printed = cell.get("outputs", [])
            shown = (
                one.get("text") or one.get("data", {}).get("text/plain", "") for one in printed
            )
            parts += [cell.get("source", ""), *shown]
        return "\n".join("".join(part) for part in parts)
    except (AttributeError, TypeError):
        # JSON of other types: a number in place of a cell, or none in place of its text.
        got = "a notebook with damaged cells"
        raise UserError(name, got, "one that Jupyter opens", "Save it there again") from None


def _of_json(name: str, content: Any, text: str = "") -> list[Sheet]:
    """The sheets in JSON, one for each table at any depth.

    text: of the whole file, which the first sheet has: the text of a chat is among what it says of
    itself.
    Raises UserError as `tables_of_json`.
    """
    sheets: list[Sheet] = []
    for called, rows in tables_of_json(name, content):
        sheets.append(Sheet(called, tuple(enumerate(rows, 1)), "" if sheets else text))
    return sheets


def _of_json_lines(text: str) -> list[Any]:
    """A record in each line of a text; empty where one is none."""
    records = []
    for line in text.splitlines():
        if not line.strip():
            continue
        try:
            records.append(parse_json(line))
        except ValueError:
            return []
    return records


def _of_markup(text: str) -> str:
    """The text of a page in HTML, or of a document of Word: a line for each row of its tables, with tabs
    between the cells.
    """
    text = re.sub(r"(?is)<(script|style)\b.*?</\1>", "", text)
    text = _ROW.sub(_tabbed, re.sub(r"\s+", " ", text))
    lines = _BARE.sub("", _BREAK.sub("\n", text)).splitlines()
    return html.unescape("\n".join(line.strip(" ") for line in lines))


def _tabbed(row: re.Match[str]) -> str:
    """A row of a table as a line; cells that are merged over several columns have empty ones after."""
    cells = []
    for cell in _CELL.finditer(row[0]):
        span = re.search(r"(?i)(?:colspan|gridspan w:val)\s*=\s*['\"]?(\d+)", cell[0])
        cells += [_BARE.sub("", cell[0]).strip(), *[""] * (int(span[1]) - 1 if span else 0)]
    return "\n" + "\t".join(cells) + "\n"


def _of_workbook(name: str, content: bytes) -> list[Sheet]:
    """Sheets of an .xls, .xlsx or .ods workbook, read by Calamine through pandas.

    Raises UserError for a damaged one.
    """
    import pandas as pd

    _require_few_cells(name, content)
    try:
        frames = pd.read_excel(
            io.BytesIO(content),
            sheet_name=None,
            header=None,
            engine="calamine",
            keep_default_na=False,
        )
    except Exception as error:
        # Calamine and pandas raise several unrelated kinds of error for damaged workbooks.
        raise UserError(
            name, f"cannot be read as a workbook: {error}", "one that a spreadsheet opens"
        ) from None
    sheets = []
    for title, frame in frames.items():
        rows = []
        for number, values in enumerate(frame.itertuples(index=False, name=None), 1):
            cells = tuple(text_of_cell(value).strip() for value in values)
            if any(cells):
                rows.append((number, cells))
        called = name if len(frames) == 1 else f"{name}, {sanitized(str(title).strip())}"
        sheets.append(Sheet(called, tuple(rows)))
    return sheets


def _require_few_cells(name: str, content: bytes) -> None:
    """Raise UserError for an .xlsx with a cell far from the others: Calamine takes memory for each
    cell between, and ends the process where there is not enough.
    """
    if not content.startswith(_ARCHIVE):
        return
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        for member in archive.namelist():
            if not member.startswith("xl/worksheets/"):
                continue
            width, height, far = 1, 1, ""
            for letters, digits in _PLACE.findall(archive.read(member)):
                column, row = _column_number(letters), int(digits)
                if column > width or row > height:
                    far = (letters + digits).decode()
                width, height = max(column, width), max(row, height)
            if width * height > _MOST_CELLS:
                got = f"a cell at {far}, far from the others"
                expected = f"at most {_MOST_CELLS} cells from A1 on"
                raise UserError(name, got, expected, "Delete the rows and columns below and beside")


def _column_number(letters: bytes) -> int:
    """The number of a column, from 1: 28 for b"AB"."""
    number = 0
    for letter in letters:
        number = 26 * number + letter - ord("A") + 1
    return number


def _of_archive(name: str, content: bytes) -> list[Sheet]:
    """Sheets of a workbook, or of the tables in a zip archive such as phyphox exports.

    Raises UserError for a damaged archive and for one without tables.
    """
    expected = "a workbook, or an archive with a .csv"
    try:
        require_small_archive(content)
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = [one for one in archive.namelist() if not one.endswith("/")]
            if any(one.startswith(("xl/", "Object")) or one == "content.xml" for one in members):
                return _of_workbook(name, content)
            if _OF_WORD in members:
                return _of_text(name, with_plain_digits(decoded(archive.read(_OF_WORD))))
            # phyphox puts what it knows of the device into meta/.
            kept = [
                one
                for one in members
                if PurePath(one).suffix.lower() in _TABLES
                and not one.startswith(("meta/", "__MACOSX"))
            ]
            if not kept:
                raise UserError(name, "a zip archive without tables", expected)
            sheets = []
            for one in kept:
                text = with_plain_digits(decoded(archive.read(one)))
                sheets += _of_text(f"{name}, {sanitized(one)}", text)
            return sheets
    except UserError:
        raise
    except (
        zipfile.BadZipFile,
        UnicodeDecodeError,
        ValueError,
        OSError,
        NotImplementedError,
        RuntimeError,
    ) as error:
        raise UserError(name, f"a zip archive that cannot be read: {error}", expected) from None
