"""Puts the ratios of a run of the benchmarks into README.md, and adds them to history.csv.

python benchmarks/table.py RESULTS.json
"""

from __future__ import annotations

import json
import sys
import textwrap
from pathlib import Path
from typing import Any

import pandas as pd

README = Path(__file__).with_name("README.md")
HISTORY = Path(__file__).with_name("history.csv")
BEGIN, END = "<!-- begin table -->", "<!-- end table -->"


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
    table = "\n".join([BEGIN, *textwrap.wrap(about, 100), "", *rows(results), END])
    text = README.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    README.write_text(before + table + rest.partition(END)[2], encoding="utf-8")
    print(table)
    history(results).to_csv(HISTORY, mode="a", header=not HISTORY.exists(), index=False)


if __name__ == "__main__":
    main()
