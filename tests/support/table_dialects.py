"""Tables as people write them: a covering design of dialects, each with what it says."""

from __future__ import annotations

import io
import json
import zipfile
from dataclasses import dataclass
from functools import cache
from itertools import zip_longest
from typing import TYPE_CHECKING, Any
from xml.sax.saxutils import escape

import numpy as np
from covering import covering_rows
from measured_bounces import synthesise

if TYPE_CHECKING:
    from collections.abc import Sequence

    from covering import Row

LAW = synthesise.hunt_crossley(0.3)


@dataclass(frozen=True)
class Column:
    """A column of a kind of data: its role, SI numbers and units: that of SI and a smaller one."""

    role: str
    values: np.ndarray
    units: tuple[tuple[str, float], tuple[str, float]]


@cache
def data(kind: str) -> tuple[Column, ...]:
    """The columns of a kind of data, of the law of 1975 with α = 0.3 s/m."""
    rng = np.random.default_rng(1)
    seconds = (("s", 1.0), ("ms", 1e-3))
    metres = (("m", 1.0), ("cm", 1e-2))
    speeds = (("m/s", 1.0), ("cm/s", 1e-2))
    ratio = (("", 1.0), ("%", 1e-2))
    times = synthesise.touch_times(LAW, 0.3, 0.0, 0.0, rng, 9)
    v = np.linspace(0.43, 2.03, 9)
    e = np.array([LAW(one) for one in v])
    film = synthesise.track(LAW, 0.5, 1e-3, 2e-4, 120, rng)
    t = np.arange(400) * 1e-5
    in_contact = (t > 1.2e-3) & (t < 2.7e-3)
    force = np.where(in_contact, 150.0 * np.round(np.sin(np.pi * (t - 1.2e-3) / 1.5e-3), 6), 0.0)
    columns = {
        "times": (Column("time", times, seconds),),
        "intervals": (Column("interval", np.diff(times), seconds),),
        "heights": (
            Column("height", synthesise.bounce_heights(LAW, 0.3, 1e-6, 0.0, rng, 9), metres),
        ),
        "pairs": (Column("speed", v, speeds), Column("e", e, ratio)),
        "speeds": (Column("before", v, speeds), Column("after", v * e, speeds)),
        "rises": (
            Column("drop", v**2 / 19.6133, metres),
            Column("rebound", (v * e) ** 2 / 19.6133, metres),
        ),
        "track": (Column("time", film[0], seconds), Column("place", film[1], metres)),
        "force": (Column("time", t, seconds), Column("force", force, (("N", 1.0), ("kN", 1e3)))),
    }
    return columns[kind]


NAMES: dict[str, dict[str, tuple[str, ...]]] = {
    "en": {
        "time": ("time", "Time", "impact time", "t"),
        "interval": ("interval", "Flight time", "dt"),
        "height": ("height", "Bounce height", "h", "rebound height"),
        "speed": ("impact speed", "v", "Impact velocity", "approach speed"),
        "e": ("restitution", "COR", "e", "Coefficient of restitution"),
        "before": ("v_in", "speed before impact", "incident velocity", "v_before"),
        "after": ("v_out", "speed after impact", "rebound velocity", "v_after"),
        "drop": ("drop height", "release height", "h_drop"),
        "rebound": ("rebound height", "bounce height", "h_rebound"),
        "place": ("height", "y", "Position", "z"),
        "force": ("force", "Force", "F"),
    },
    "de": {
        "time": ("Zeit", "Zeitpunkt", "Aufprallzeit"),
        "interval": ("Flugzeit", "Zeitintervall", "Intervall"),
        "height": ("Höhe", "Sprunghöhe", "Rückprallhöhe"),
        "speed": ("Aufprallgeschwindigkeit", "Geschwindigkeit", "Auftreffgeschwindigkeit"),
        "e": ("Stoßzahl", "Restitutionskoeffizient", "e"),
        "before": ("Geschwindigkeit vorher", "v_vor", "Geschwindigkeit vor dem Stoß"),
        "after": ("Geschwindigkeit nachher", "v_nach", "Geschwindigkeit nach dem Stoß"),
        "drop": ("Fallhöhe", "Abwurfhöhe"),
        "rebound": ("Rückprallhöhe", "Sprunghöhe"),
        "place": ("Höhe", "y", "Position"),
        "force": ("Kraft", "F"),
    },
    "fr": {
        "time": ("temps", "instant", "Temps"),
        "interval": ("intervalle", "durée de vol", "temps de vol"),
        "height": ("hauteur", "hauteur de rebond", "Hauteur du rebond"),
        "speed": ("vitesse d'impact", "vitesse", "vitesse incidente"),
        "e": ("coefficient de restitution", "e"),
        "before": ("vitesse avant", "vitesse avant le choc", "v_avant"),
        "after": ("vitesse après", "vitesse après le choc", "v_après"),
        "drop": ("hauteur de chute", "hauteur initiale"),
        "rebound": ("hauteur de rebond", "hauteur du rebond"),
        "place": ("hauteur", "y", "position"),
        "force": ("force", "Force", "F"),
    },
    "es": {
        "time": ("tiempo", "Tiempo", "instante"),
        "interval": ("intervalo", "tiempo de vuelo"),
        "height": ("altura", "altura de rebote", "Altura del rebote"),
        "speed": ("velocidad de impacto", "velocidad", "rapidez de impacto"),
        "e": ("coeficiente de restitución", "e"),
        "before": ("velocidad antes", "velocidad antes del choque", "velocidad de entrada"),
        "after": ("velocidad después", "velocidad después del choque", "velocidad de salida"),
        "drop": ("altura de caída", "altura inicial"),
        "rebound": ("altura de rebote", "altura del rebote"),
        "place": ("altura", "y", "posición"),
        "force": ("fuerza", "Fuerza"),
    },
    "it": {
        "time": ("tempo", "istante", "Tempo"),
        "interval": ("intervallo", "tempo di volo"),
        "height": ("altezza", "altezza di rimbalzo", "altezza del rimbalzo"),
        "speed": ("velocità di impatto", "velocità", "velocità d'impatto"),
        "e": ("coefficiente di restituzione", "e"),
        "before": ("velocità prima", "velocità prima dell'urto", "v_prima"),
        "after": ("velocità dopo", "velocità dopo l'urto", "v_dopo"),
        "drop": ("altezza di caduta", "altezza iniziale"),
        "rebound": ("altezza di rimbalzo", "altezza del rimbalzo"),
        "place": ("altezza", "y", "posizione"),
        "force": ("forza", "Forza"),
    },
    "pt": {
        "time": ("tempo", "instante", "Tempo"),
        "interval": ("intervalo", "tempo de voo"),
        "height": ("altura", "altura do ressalto", "altura do quique"),
        "speed": ("velocidade de impacto", "velocidade"),
        "e": ("coeficiente de restituição", "e"),
        "before": ("velocidade antes", "velocidade antes do choque"),
        "after": ("velocidade depois", "velocidade depois do choque"),
        "drop": ("altura de queda", "altura inicial"),
        "rebound": ("altura do ressalto", "altura do quique"),
        "place": ("altura", "y", "posição"),
        "force": ("força", "Força"),
    },
    "ru": {
        "time": ("время", "Время", "момент удара"),
        "interval": ("интервал", "время полёта"),
        "height": ("высота", "высота отскока"),
        "speed": ("скорость удара", "скорость"),
        "e": ("коэффициент восстановления", "e"),
        "before": ("скорость до удара", "скорость до"),
        "after": ("скорость после удара", "скорость после"),
        "drop": ("высота падения", "начальная высота"),
        "rebound": ("высота отскока",),
        "place": ("высота", "y", "координата"),
        "force": ("сила", "Сила"),
    },
    "zh": {
        "time": ("时间", "碰撞时刻"),
        "interval": ("时间间隔", "飞行时间"),
        "height": ("高度", "反弹高度"),
        "speed": ("碰撞速度", "速度", "入射速度"),
        "e": ("恢复系数", "e"),
        "before": ("碰撞前速度", "入射速度"),
        "after": ("碰撞后速度", "反弹速度"),
        "drop": ("下落高度", "初始高度"),
        "rebound": ("反弹高度", "回弹高度"),
        "place": ("高度", "y", "位置"),
        "force": ("力", "接触力"),
    },
}
UNITS = ("s", "ms", "m", "cm", "m/s", "cm/s", "N", "kN")
# Words for the number of a row, and for a note, by language.
NUMBERS = dict(
    zip(NAMES, ("bounce", "Nr.", "n°", "rebote", "numero", "n°", "№", "序号"), strict=True)
)
NOTES = dict(
    zip(
        NAMES,
        ("note", "Bemerkung", "remarque", "notas", "note", "notas", "примечание", "备注"),
        strict=True,
    )
)
# Units in words of a language, where they are not those of SI.
WORDS_OF_UNITS = {
    "ru": dict(zip(UNITS, ("с", "мс", "м", "см", "м/с", "см/с", "Н", "кН"), strict=True)),
    "zh": dict(
        zip(UNITS, ("秒", "毫秒", "米", "厘米", "米/秒", "厘米/秒", "牛", "kN"), strict=True)
    ),
}
TEXTS = ("comma", "semicolon", "tab", "pipe", "blanks", "aligned", "markdown", "latex", "rows")
FACTORS: dict[str, Sequence[Any]] = {
    "kind": ("times", "intervals", "heights", "pairs", "speeds", "rises", "track", "force"),
    "layout": (*TEXTS, "json records", "json columns", "json split", "json lines", "workbook"),
    "decimal": (".", ","),
    "encoding": ("utf-8", "utf-8-sig", "cp1252", "utf-16", "utf-16-le"),
    "units": ("square", "round", "slash", "suffix", "row", "comma", "cells", "none needed"),
    "scale": (0, 1),
    "language": tuple(NAMES),
    "extra": ("none", "index", "numbered", "note", "sideways", "computed", "empty column"),
    "before": ("nothing", "# lines", "% lines", "// lines", "metadata", "title", "savetxt"),
    "numbers": ("plain", "exponent", "quoted", "uncertain"),
    "rows": ("whole", "missing", "turned", "summed up", "blank lines"),
    "end": ("\n", "\r\n"),
}


def allowed(row: Row) -> bool:
    """Say whether levels go together: a comma is not both, and Latin letters have no Chinese."""
    has = row.get
    layout = has("layout") or ""
    no_text = layout.startswith("json") or layout == "workbook"
    rules = (
        has("decimal") == ","
        and ((layout == "comma" and has("numbers") not in (None, "quoted")) or no_text),
        has("decimal") == ","
        and layout in ("comma", "rows")
        and has("numbers") not in (None, "quoted"),
        has("encoding") == "cp1252" and has("language") in ("ru", "zh"),
        no_text and has("encoding") not in (None, "utf-8"),
        no_text and has("before") not in (None, "nothing"),
        no_text and has("numbers") not in (None, "plain"),
        no_text and has("rows") in ("summed up", "blank lines"),
        layout.startswith("json") and has("units") in ("row",),
        layout.startswith("json") and has("extra") == "empty column",
        layout.startswith("json") and layout != "json split" and has("extra") == "index",
        layout == "rows" and has("units") == "row",
        layout == "rows" and has("rows") in ("summed up",),
        layout == "rows" and has("extra") in ("index", "empty column"),
        layout == "rows" and has("before") == "savetxt",
        layout in ("markdown", "latex") and has("before") == "savetxt",
        layout in ("blanks", "aligned", "latex", "markdown") and has("numbers") == "quoted",
        layout in ("blanks", "aligned") and has("units") == "cells",
        layout in ("blanks", "aligned") and has("extra") in ("empty column", "note", "index"),
        layout in ("blanks", "aligned") and has("rows") == "missing",
        layout in ("blanks", "aligned") and has("numbers") == "uncertain",
        has("extra") == "empty column" and layout == "latex",
        has("units") == "none needed" and has("kind") not in (None, "track", "times"),
        has("units") == "none needed" and has("scale") == 1,
        has("units") == "none needed" and has("extra") in ("sideways", "computed"),
        layout in ("blanks", "aligned") and has("units") == "comma",
        has("units") == "cells" and has("numbers") == "uncertain",
        has("units") == "comma" and layout == "comma" and has("numbers") not in (None, "quoted"),
        has("numbers") == "uncertain" and has("kind") in ("track", "force"),
        has("rows") == "missing" and has("kind") in ("times", "intervals", "heights"),
        has("rows") == "turned" and has("kind") not in (None, "times", "track", "force", "pairs"),
        has("rows") == "summed up" and has("kind") not in (None, "pairs", "heights", "speeds"),
        has("extra") == "sideways" and has("kind") not in (None, "track", "force"),
        has("extra") == "computed"
        and has("kind") not in (None, "track", "speeds", "rises", "times"),
        has("before") == "savetxt" and has("units") == "row",
    )
    return not any(rules)


def _completes(row: Row) -> bool:
    """Say whether levels go together, and every other factor has one that goes with them."""
    others = [name for name in FACTORS if name not in row]
    return allowed(row) and all(
        any(allowed({**row, name: level}) for level in FACTORS[name]) for name in others
    )


@dataclass(frozen=True)
class Dialect:
    """A file and what it says: its levels, name, content, and its kind of data."""

    row: tuple[tuple[str, Any], ...]
    name: str
    content: bytes
    kind: str


def dialects(count: int, seed: int) -> list[Dialect]:
    """A covering design of tables: `count` of them, drawn by the seed."""
    rows = covering_rows(FACTORS, count, _completes, seed)
    return [write(row, np.random.default_rng([seed, i])) for i, row in enumerate(rows)]


def write(row: Row, rng: np.random.Generator) -> Dialect:
    """The file of one row of the design."""
    header, units, columns = _columns(row, rng)
    written = [_with_unit(name, unit, row, rng) for name, unit in zip(header, units, strict=True)]
    table = [list(cells) for cells in zip(*columns, strict=True)]
    if row["rows"] == "turned":
        table.reverse()
    if row["rows"] == "missing":
        for i in (3, len(table) - 3):
            at = len(header) - 1 - (row["extra"] in ("note", "empty column"))
            table[i][at] = str(rng.choice(["", "NaN", "n/a", "-"]))
    if row["rows"] == "summed up":
        table.append(["mean", *["1.0"] * (len(header) - 1)] if len(header) > 1 else ["mean"])
    if row["layout"].startswith("json"):
        content = _json(row, written, table).encode()
        return Dialect(tuple(row.items()), "data.json", content, row["kind"])
    no_unit = "-" if row["layout"] in ("blanks", "aligned") else ""
    rows = [written, *table]
    if row["units"] == "row":
        rows.insert(1, [f"[{unit}]" if unit else no_unit for unit in units])
    if row["layout"] == "workbook":
        content = workbook({"Sheet1": rows, "Sheet2": []})
        return Dialect(tuple(row.items()), "data.xlsx", content, row["kind"])
    lines = _lines(row, rows)
    lines = _with_before(row, lines)
    if row["rows"] == "blank lines":
        lines = [*lines[:2], "", *lines[2:], "", ""]
    text = row["end"].join(lines) + row["end"]
    return Dialect(tuple(row.items()), "data.csv", text.encode(row["encoding"]), row["kind"])


def _columns(row: Row, rng: np.random.Generator) -> tuple[list[str], list[str], list[list[str]]]:
    """Names, units and cells of each column."""
    names: list[str] = []
    units: list[str] = []
    cells: list[list[str]] = []
    language = NAMES[row["language"]]
    of_kind = data(row["kind"])
    for column in of_kind:
        unit, scale = column.units[row["scale"]]
        names.append(str(rng.choice(language[column.role])))
        if row["units"] == "none needed":
            units.append("")
        else:
            units.append(WORDS_OF_UNITS.get(row["language"], {}).get(unit, unit))
        cells.append([_number(value / scale, row, units[-1]) for value in column.values])
    count = len(cells[0])
    extra = row["extra"]
    if extra == "computed":
        more = {
            "track": ("v_y", "m/s"),
            "speeds": ("e", ""),
            "rises": (str(rng.choice(language["e"])), ""),
            "times": (str(rng.choice(language["interval"])), of_kind[0].units[row["scale"]][0]),
        }
        name, unit = more[row["kind"]]
        values = [column.values for column in of_kind]
        if row["kind"] == "track":
            computed = np.gradient(values[1], values[0])
        elif row["kind"] == "speeds":
            computed = values[1] / values[0]
        elif row["kind"] == "rises":
            computed = np.sqrt(values[1] / values[0])
        else:
            computed = np.append(np.diff(values[0]), 0.0) / of_kind[0].units[row["scale"]][1]
        names.append(name)
        units.append(WORDS_OF_UNITS.get(row["language"], {}).get(unit, unit))
        cells.append([_number(value, {**row, "numbers": "plain"}, units[-1]) for value in computed])
    if extra in ("index", "numbered"):
        names.insert(0, "" if extra == "index" else NUMBERS[row["language"]])
        units.insert(0, "")
        cells.insert(0, [str(i + (extra == "numbered")) for i in range(count)])
    elif extra == "note":
        names.append(NOTES[row["language"]])
        units.append("")
        cells.append([["ok", "", "late"][i % 3] for i in range(count)])
    elif extra == "sideways":
        names.append("x" if row["kind"] == "track" else "Fx")
        units.append("m" if row["kind"] == "track" else "N")
        cells.append(
            [_number(1e-3 * i, {**row, "numbers": "plain"}, units[-1]) for i in range(count)]
        )
    elif extra == "empty column":
        names.append("")
        units.append("")
        cells.append([""] * count)
    return names, units, cells


def _number(value: float, row: Row, unit: str) -> str:
    """A number as the row's levels write it."""
    text = f"{value:.7g}" if abs(value) > 1e-4 else f"{value:.9f}"
    if row["numbers"] == "exponent":
        text = f"{value:.6E}"
    if row["numbers"] == "uncertain":
        text = f"{value:.6f} ± {2e-3 * abs(value):.6f}"
    text = text.replace(".", row["decimal"])
    if row["units"] == "cells" and unit:
        text = f"{text} {unit}"
    return text


def _with_unit(name: str, unit: str, row: Row, rng: np.random.Generator) -> str:
    """A name with its unit as the row's levels write it."""
    if not unit or row["units"] in ("row", "cells", "none needed"):
        return name
    if row["units"] == "square":
        return f"{name} [{unit}]"
    if row["units"] == "round":
        return f"{name}{rng.choice(['', ' '])}({unit})"
    if row["units"] == "slash":
        return f"{name}/({unit})" if "/" in unit else f"{name}/{unit}"
    if row["units"] == "comma":
        return f"{name}, {unit}"
    return f"{name.replace(' ', '_')}_{unit.replace('/', '_')}"


def _json(row: Row, header: list[str], table: list[list[str]]) -> str:
    """The table as JSON in the row's layout."""

    def value(text: str) -> Any:
        try:
            number = float(text)
        except ValueError:
            return text or None
        return None if np.isnan(number) else number

    records = [dict(zip(header, map(value, cells), strict=True)) for cells in table]
    layout = row["layout"]
    if layout == "json lines":
        return "\n".join(json.dumps(one, ensure_ascii=False) for one in records)
    if layout == "json columns":
        columns = {name: [value(cells[i]) for cells in table] for i, name in enumerate(header)}
        return json.dumps({"experiment": "drop", "data": columns}, ensure_ascii=False, indent=1)
    if layout == "json split":
        data = [list(map(value, cells)) for cells in table]
        return json.dumps({"columns": header, "data": data}, ensure_ascii=False)
    return json.dumps(records, ensure_ascii=False)


def _lines(row: Row, rows: list[list[str]]) -> list[str]:
    """The rows as lines of text in the row's layout."""
    layout = row["layout"]
    signs = {"comma": ",", "semicolon": ";", "tab": "\t", "pipe": "|", "blanks": " "}
    if row["numbers"] == "quoted":
        rows = [[f'"{cell}"' for cell in cells] for cells in rows]
    if layout == "rows":
        turned = zip_longest(*rows, fillvalue="")
        return [("," if row["decimal"] == "." else ";").join(cells) for cells in turned]
    if layout == "markdown":
        lines = ["| " + " | ".join(cells) + " |" for cells in rows]
        return [lines[0], "|" + "---|" * len(rows[0]), *lines[1:]]
    if layout == "latex":
        joined = [" & ".join(cells).replace("%", "\\%").replace("±", "\\pm") for cells in rows]
        lines = [f"{text} \\\\" for text in joined]
        begin = ["\\begin{tabular}{" + "c" * len(rows[0]) + "}", "\\hline", lines[0], "\\hline"]
        return [*begin, *lines[1:], "\\hline", "\\end{tabular}"]
    if layout == "aligned":
        widths = [max(map(len, column)) for column in zip_longest(*rows, fillvalue="")]
        return ["  ".join(map(str.rjust, cells, widths)) for cells in rows]
    return [signs[layout].join(cells) for cells in rows]


def _with_before(row: Row, lines: list[str]) -> list[str]:
    """The lines with what the row's levels put before them."""
    before = row["before"]
    if before == "savetxt":
        return [f"# {lines[0]}", *lines[1:]]
    if before == "metadata":
        about = ("Experiment: drop of a ball", "Operator: Ann", "Date: 2024-03-05", "Air: 21.5 °C")
        return [*about, "", *lines]
    if before == "title":
        return ["Run 3", *lines]
    mark = before.partition(" ")[0]
    if mark in ("#", "%", "//"):
        return [f"{mark} dropped on Monday, by Ann", f"{mark} plate: steel; ball: 10 mm", *lines]
    return lines


def workbook(sheets: dict[str, list[list[str]]]) -> bytes:
    """An .xlsx workbook: numbers as numbers, other cells as text."""
    files = {
        "[Content_Types].xml": '<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">'
        '<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>'
        '<Default Extension="xml" ContentType="application/vnd.openxmlformats-officedocument.'
        'spreadsheetml.sheet.main+xml"/>'
        "</Types>",
        "_rels/.rels": _relations({"rId1": ("officeDocument", "xl/workbook.xml")}),
        "xl/_rels/workbook.xml.rels": _relations(
            {
                f"rId{i}": ("worksheet", f"worksheets/sheet{i}.xml")
                for i in range(1, len(sheets) + 1)
            }
        ),
        "xl/workbook.xml": '<workbook xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main" '
        'xmlns:r="http://schemas.openxmlformats.org/officeDocument/2006/relationships"><sheets>'
        + "".join(
            f'<sheet name="{escape(name)}" sheetId="{i}" r:id="rId{i}"/>'
            for i, name in enumerate(sheets, 1)
        )
        + "</sheets></workbook>",
    }
    for i, rows in enumerate(sheets.values(), 1):
        cells = "".join("<row>" + "".join(map(_xml_cell, row)) + "</row>" for row in rows)
        files[f"xl/worksheets/sheet{i}.xml"] = (
            '<worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main">'
            f"<sheetData>{cells}</sheetData></worksheet>"
        )
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, text in files.items():
            archive.writestr(name, '<?xml version="1.0" encoding="UTF-8"?>' + text)
    return out.getvalue()


def _relations(of: dict[str, tuple[str, str]]) -> str:
    """Relations between parts of a workbook: of each, its kind and target."""
    base = "http://schemas.openxmlformats.org/officeDocument/2006/relationships"
    inner = "".join(
        f'<Relationship Id="{key}" Type="{base}/{kind}" Target="{target}"/>'
        for key, (kind, target) in of.items()
    )
    schema = "http://schemas.openxmlformats.org/package/2006/relationships"
    return f'<Relationships xmlns="{schema}">{inner}</Relationships>'


def _xml_cell(text: str) -> str:
    """A cell of a sheet: a number, or text in place."""
    try:
        return f"<c><v>{float(text)!r}</v></c>"
    except ValueError:
        return f'<c t="inlineStr"><is><t>{escape(text)}</t></is></c>'
