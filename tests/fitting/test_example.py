"""The recording of the example, from the sound to a tuned scene."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from measured_bounces import synthesise
from scipy.io import wavfile

from hcbench.cli import run


def test_the_recording_of_the_example_goes_all_the_way_to_a_tuned_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    example = Path(synthesise.__file__).with_name("drop.wav")
    monkeypatch.setattr(sys, "argv", ["synthesise.py", str(tmp_path / "again.wav")])
    synthesise.main()
    assert (
        np.abs(wavfile.read(tmp_path / "again.wav")[1] - wavfile.read(example)[1].astype(int)).max()
        <= 1
    )
    page, scene = tmp_path / "drop.html", tmp_path / "tuned.xml"
    assert (
        run(["fit", str(example), "--gravity", "9.80665 m/s^2", "--page", str(page), "--json"]) == 0
    )
    found = json.loads(capsys.readouterr().out)
    low, high = found["alpha_interval_95_s_per_m"]
    assert found["law"] == "hunt-crossley" and low < 0.3 < high
    text = page.read_text(encoding="utf-8")
    assert (
        text.count("data:image/svg+xml") == 4
        and "<audio controls" in text
        and "--touches A" in text
        and "<script" not in text
    )
    alpha = f"{found['alpha_s_per_m']:.4f} +- {found['alpha_standard_uncertainty_s_per_m']:.4f} s/m"
    said = ["--alpha", alpha, "--timestep", "1e-3", "--speeds", "0.2:1.4 m/s"]
    assert run(["tune", "mujoco", *said, "--write-scene", str(scene)]) == 0
    assert "e is known to ± 0.00" in capsys.readouterr().out
    gate = ["--pair", "ball,plate", "--alpha", alpha, "--speeds", "0.3, 1 m/s"]
    assert run(["check", str(scene), *gate]) == 0
    assert "by which e is known to ± 0.00" in capsys.readouterr().out
