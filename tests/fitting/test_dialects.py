"""Exports of programs and ways to write a table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from measured_bounces import synthesise, times_of, write

from hcbench.cli import run


def test_trackers_export_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    times, heights = synthesise.track(
        synthesise.hunt_crossley(0.2), 0.5, 4e-3, 1e-3, 120, np.random.default_rng(1)
    )
    rows = [f"{t:.9E}\t0.0E0\t{y:.9E}\t" for t, y in zip(times, heights, strict=True)]
    text = "\n".join(["mass A", "t\tx\ty\tv_{y}", *rows])
    for content in (text, text.replace(".", ",")):
        assert run(["fit", write(tmp_path, content, "track.txt"), "--json"]) == 0
        low, high = json.loads(capsys.readouterr().out)["alpha_interval_95_s_per_m"]
        assert low < 0.2 < high
    two = "\n".join(
        ["#multi:", "mass A\t\t\tmass B", "t\tx\ty\tt\tx\ty", *(2 * row for row in rows)]
    )
    assert run(["fit", write(tmp_path, two, "two.txt")]) == 2
    assert "several tracks" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("separator", "decimal"), [(",", "."), ("\t", "."), (";", "."), ("\t", ","), (";", ",")]
)
def test_phyphox_exports_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], separator: str, decimal: str
) -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 3, most=6)
    names, cells = [], []
    for i, t in enumerate(times):
        names += [f'"Bounce {i} (s)"', f'"Height {i} (m)"', *([f'"Energy {i}"'] if i else [])]
        cells += [f"{t:.9E}", "1.0E-1", *(["5.0E-1"] if i else [])]
    row = separator.join(cells).replace(".", decimal)
    path = write(tmp_path, f"{separator.join(names)}\n{row}\n")
    assert run(["fit", path, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["files"][0]["kind"] == "times"
    low, high = found["alpha_interval_95_s_per_m"]
    assert low < 0.3 < high
