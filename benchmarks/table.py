"""Puts a run of the benchmarks into the pages that show it, and adds it to history.csv.

python benchmarks/table.py RESULTS.json

benchmarks/README.md gets the table and what falls short of its limits, the project's README.md the
times in its sentence on speed.
"""

from __future__ import annotations

import json
import re
import sys
import textwrap
from pathlib import Path
from typing import Any

import pandas as pd

README = Path(__file__).with_name("README.md")
HISTORY = Path(__file__).with_name("history.csv")
FRONT = README.parents[1] / "README.md"
BEGIN, END = "<!-- begin table -->", "<!-- end table -->"
BEGIN_SHORT, END_SHORT = "<!-- begin short -->", "<!-- end short -->"
# Rows whose times the project's README tells, in the order of its sentence.
TOLD = (
    "a million drops, MuJoCo at 1 ms, processor time",
    "hcbench measure of README's quadruped, processor time",
    "hcbench tune --plugin, processor time",
)


def readable(value: float, unit: str) -> str:
    """With three digits and a unit that suits."""
    if unit != "s":
        return f"{value:.3g} {unit}"
    for size, name in ((1.0, "s"), (1e-3, "ms"), (1e-6, "µs"), (1e-9, "ns")):
        if value >= size:
            return f"{value / size:.3g} {name}"
    return f"{value:.3g} s"


def rows(results: dict[str, Any]) -> list[str]:
    """A row for each candidate; ours with the ratio to what it is measured against."""
    lines = ["| what | who | takes | others / hcbench | must | aim |", "|---|---|---|---|---|---|"]
    for one in results["benchmarks"]:
        info = one["extra_info"]
        own = (
            info["seconds"]["hcbench"]
            if "hcbench" in info["seconds"]
            else list(info["seconds"].values())[-1]
        )
        for i, (name, value) in enumerate(info["seconds"].items()):
            last = i == len(info["seconds"]) - 1
            ratio = "" if last else f"{value / own:.3g}"
            marks = (info["must"], info["aim"]) if i == 0 else ("", "")
            takes = readable(value, info["unit"]) + (f" ({info['also']})" if "also" in info else "")
            lines.append(
                f"| {info['what'] if i == 0 else ''} | {name} | {takes} | {ratio} | {marks[0]} | {marks[1]} |"
            )
    return lines


def limit(must: str) -> float:
    """A limit as a number: seconds, MiB, per cent, or a ratio such as 3, 1/1.2 or 10⁴."""
    amount, _, unit = must.partition(" ")
    if unit:
        return float(amount) * (1024.0 if unit == "GiB" else 1.0)
    if power := re.fullmatch(r"10([⁰¹²³⁴⁵⁶⁷⁸⁹])", must):
        return 10.0 ** "⁰¹²³⁴⁵⁶⁷⁸⁹".index(power[1])
    above, _, below = must.partition("/")
    return float(above) / float(below or 1.0)


def shortfalls(results: dict[str, Any]) -> list[str]:
    """A line for each row that misses what it must be: what is measured, and what was asked."""
    lines = []
    for one in results["benchmarks"]:
        info = one["extra_info"]
        must = info["must"]
        if not must:
            continue
        first, *_, own = [*info["seconds"].values()] * 2
        is_ratio = " " not in must
        value = first / own if is_ratio else own
        if value < limit(must) if is_ratio else value > limit(must):
            shown = f"{value:.3g}" if is_ratio else readable(value, info["unit"])
            lines.append(f"- {info['what']}: {shown}, must {must};")
    return [*lines[:-1], *(line.removesuffix(";") + "." for line in lines[-1:])] or ["- none."]


def between(text: str, begin: str, end: str, new: str) -> str:
    """The text with what is between two marks replaced."""
    before, _, rest = text.partition(begin)
    return f"{before}{begin}\n{new}\n{end}{rest.partition(end)[2]}"


def told(text: str, results: dict[str, Any]) -> str:
    """The project's README with this run's times in its sentence on speed."""
    takes = {}
    for one in results["benchmarks"]:
        info = one["extra_info"]
        takes[info["what"]] = readable(info["seconds"].get("hcbench", 0.0), info["unit"])
    # The lines of the page may break anywhere.
    number = r"([\d.]+\s+\w+)"
    words = (
        f"A million drops take {number} of a processor in MuJoCo, e of a robot's foot {number},"
        f" the plug-in's text {number}"
    )
    found = re.search(words.replace(" ", r"\s+"), text)
    assert found is not None, f"{FRONT} has no sentence like {words!r}"
    for place, row in reversed(list(enumerate(TOLD, 1))):
        text = text[: found.start(place)] + takes[row] + text[found.end(place) :]
    return text


def history(results: dict[str, Any]) -> pd.DataFrame:
    """A row a candidate: when, of which commit and where it was
    measured, what it took, and its ratio.
    """
    machine = results["machine_info"]
    run = {
        "date": results["datetime"][:10],
        "commit": results["commit_info"]["id"][:10],
        "processor": machine["cpu"].get("brand_raw", machine["processor"]),
        "cores": machine["cores"],
        "load": round(machine["load"], 1),
    }
    return pd.DataFrame(
        {
            **run,
            "what": one["extra_info"]["what"],
            "who": name,
            "takes": float(f"{value:.4g}"),
            "unit": one["extra_info"]["unit"],
            "over_hcbench": float(f"{value / list(one['extra_info']['seconds'].values())[-1]:.4g}"),
        }
        for one in results["benchmarks"]
        for name, value in one["extra_info"]["seconds"].items()
    )


def main() -> None:
    results = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    machine = results["machine_info"]
    engines = ", ".join(f"{name} {version}" for name, version in machine["engines"].items())
    processor = machine["cpu"].get("brand_raw", machine["processor"])
    about = (
        f"{results['datetime'][:10]}, {processor}, {machine['cores']} cores, load {machine['load']:.1f} as it"
        f" began; CPython {machine['python_version']}, {engines}."
    )
    table = "\n".join([*textwrap.wrap(about, 100), "", *rows(results)])
    text = between(README.read_text(encoding="utf-8"), BEGIN, END, table)
    short = "\n".join(shortfalls(results))
    README.write_text(between(text, BEGIN_SHORT, END_SHORT, short), encoding="utf-8")
    FRONT.write_text(told(FRONT.read_text(encoding="utf-8"), results), encoding="utf-8")
    print(table)
    print(short)
    history(results).to_csv(HISTORY, mode="a", header=not HISTORY.exists(), index=False)


if __name__ == "__main__":
    main()
