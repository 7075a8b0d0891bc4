"""Results in, a folder out: the page, scores.csv, the impacts that were read, and the parameters."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path

from hcbench.reality import scores
from hcbench.reality.evidence import good
from hcbench.reality.impacts import COLUMNS, ImpactRead
from hcbench.reality.page import page_text
from hcbench.reality.poses import PAIRS, Own
from hcbench.reality.study import RealityResults
from hcbench.reporting.page import PAGE
from hcbench.system.errors import UserError
from hcbench.system.files import atomic_folder, json_text, write_text

IMPACTS = "impacts.csv"
PARAMETERS = "parameters.json"


def build_own(own: Own, folder: Path) -> None:
    """Write the tables of a user's tosses into `folder`: all impacts,
    those for `hcbench fit`, scores.
    """
    with atomic_folder(folder, IMPACTS) as scratch:
        write_text(scratch / IMPACTS, impacts_text(own.impacts))
        write_text(scratch / PAIRS, pairs_text([each for each in own.impacts if each.good]))
        write_text(scratch / scores.FILE, scores.csv_text(score for score, _ in own.scores))


def build(results: RealityResults, folder: Path) -> Path:
    """Write the study into `folder` and return its page. All of it appears, or nothing.

    The same results give the same bytes. Raises OutputError where the folder cannot be written,
    UserError where it holds a study of more data sets.
    """
    if lost := scores.sets_in(folder) - set(results.request.sets):
        raise UserError(
            "--out", f"{folder} holds a study with {', '.join(sorted(lost))}", "another folder"
        )
    with atomic_folder(folder, PAGE) as scratch:
        write_text(scratch / PAGE, page_text(results))
        write_text(scratch / scores.FILE, scores.csv_text(results.scores))
        write_text(scratch / PARAMETERS, json_text(results.parameters))
        if results.impacts:
            write_text(scratch / IMPACTS, impacts_text(results.impacts))
            write_text(scratch / PAIRS, pairs_text(good(results.impacts)))
    return folder / PAGE


def impacts_text(impacts: Sequence[ImpactRead]) -> str:
    """Everything that was read of the impacts, a line each."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for impact in impacts:
        row = []
        for value in astuple(impact):
            if isinstance(value, float):
                row.append(f"{value:.6g}")
            else:
                row.append(value)
        writer.writerow(row)
    return text.getvalue()


def pairs_text(impacts: Sequence[ImpactRead]) -> str:
    """Impact speeds and e, as `hcbench fit` reads them."""
    lines = [f"{each.number},{each.speed_in:.6g},{each.e:.6g},{each.u_e:.6g}\n" for each in impacts]
    return "trial,speed [m/s],restitution,u_restitution\n" + "".join(lines)
