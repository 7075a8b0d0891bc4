"""The example of real drops: copies and fits the files of a clone; its page has its numbers."""

from __future__ import annotations

import csv
import importlib.util
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from measured_bounces import synthesise, times_of

ROOT = Path(__file__).parents[2]
HOWTO = ROOT / "docs" / "howto"


def rows_of(path: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def test_the_example_fits_each_ball_of_a_clone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = importlib.util.spec_from_file_location("real_drops", ROOT / "examples/real_drops.py")
    assert spec is not None and spec.loader is not None
    example = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "real_drops", example)
    spec.loader.exec_module(example)
    ball = example.Ball("pingpong_ball/*.xlsx")
    monkeypatch.setattr(example, "BALLS", {"a ball": ball})
    clone, folder = tmp_path / "clone", tmp_path / "drops"
    with pytest.raises(SystemExit, match="expected a clone"):
        example.copies(clone, folder, ball)
    data = clone / example.DATA / "pingpong_ball"
    data.mkdir(parents=True)
    times = times_of(synthesise.constant(0.8), 1)
    rows = "".join(f"{t:.5f}\t{dt:.5f}\n" for t, dt in zip(times, np.diff(times), strict=False))
    (data / "1.xlsx").write_text(f"Event time (s)\tInterval (s)\n{rows}")
    monkeypatch.setattr(sys, "argv", ["real_drops.py", str(clone), str(folder)])
    example.main()
    (row,) = rows_of(folder / "drops.csv")
    assert row["law"] == "constant"
    assert float(row["e_low"]) <= 0.8 <= float(row["e_high"])
    assert "<svg" in (folder / "drops.svg").read_text(encoding="utf-8")


def test_the_page_has_the_numbers_of_the_table_that_the_example_wrote() -> None:
    page = (HOWTO / "real-drops.md").read_text(encoding="utf-8")
    rows = rows_of(HOWTO / "real-drops.csv")
    assert sum(int(row["drops"]) for row in rows) == int(re.findall(r"(\d+) real drops", page)[0])
    for row in rows:
        (line,) = (line for line in page.splitlines() if line.startswith(f"| {row['ball']} |"))
        e, low, high = (float(row[key]) for key in ("e", "e_low", "e_high"))
        assert f"| {row['drops']} | {row['law'] or 'undecided'} |" in line
        assert f"{e:.3f} [{low:.3f}, {high:.3f}]" in line
        assert f"{float(row['from_m_per_s']):.2f} ... {float(row['to_m_per_s']):.1f} m/s" in line
