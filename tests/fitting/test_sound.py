"""Touches heard in recordings."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from measured_bounces import synthesise, wav

from hcbench.cli import run
from hcbench.fitting import listening
from hcbench.fitting.estimate import fit_law
from hcbench.fitting.listening import listen, quick_score
from hcbench.fitting.recording import FrequencyBand, Recording, Timer, read_recording
from hcbench.fitting.setup import MeasurementSetup
from hcbench.fitting.which_law import LAWS, WITH_E0
from hcbench.system.errors import UserError


@pytest.mark.parametrize("surface", synthesise.SURFACES)
def test_touches_are_heard(surface: str) -> None:
    rng = np.random.default_rng(1)
    for decibels in (50, 40, 30):
        sound, at = synthesise.drop_recording(
            synthesise.hunt_crossley(0.3), 0.4, 3e-3, surface, decibels, rng, seconds=4.0
        )
        picks = listen(Recording("r", sound, 44100), MeasurementSetup())[0]
        heard = at[picks.numbers]
        assert len(heard) >= len(at) - 10
        off = picks.times - heard
        assert np.abs(off - np.median(off)).max() < 3e-3
        assert np.median(np.abs(off - np.median(off))) < 2e-5


def test_a_timer_needs_a_click() -> None:
    none = np.array([], dtype=np.intp)
    band = FrequencyBand(2000.0, np.zeros(44100), 44100, none, np.array([]))
    with pytest.raises(ValueError, match="no click"):
        Timer(band, none)


@pytest.mark.parametrize("kind", ["8", "16", "24", "float", "stereo"])
def test_all_kinds_of_wav_are_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str
) -> None:
    sound, _ = synthesise.drop_recording(
        synthesise.hunt_crossley(0.5), 0.3, 3e-3, "stone", 45, np.random.default_rng(2), 0.05
    )
    path = str(wav(tmp_path / "drop.wav", kind, sound))
    assert run(["fit", path, "--json", "--touches", "1:6"]) == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found["alpha_interval_95_s_per_m"]
    assert low < 0.5 < high
    assert found["files"][0]["impacts"] == 4


@pytest.mark.parametrize("kind", ["16", "24", "stereo"])
def test_a_recording_from_a_pipe_states_no_true_length_and_is_read(
    tmp_path: Path, kind: str
) -> None:
    sound = np.random.default_rng(3).uniform(-1.0, 1.0, 44100)
    whole = wav(tmp_path / "whole.wav", kind, sound)
    content = bytearray(whole.read_bytes())
    at = content.index(b"data") + 4
    content[4:8] = content[at : at + 4] = b"\xff\xff\xff\xff"
    (tmp_path / "piped.wav").write_bytes(content)
    of_pipe = read_recording(tmp_path / "piped.wav", quick_score)
    of_file = read_recording(whole, quick_score)
    np.testing.assert_array_equal(of_pipe.sound, of_file.sound)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        (
            "drop.m4a",
            b"\0\0\0 ftypM4A \xff\xfe",
            r"hcbench\[sound\].*ffmpeg -i drop.m4a|cannot be read",
        ),
        ("drop.wav", b"RIFF\4\0\0\0WAVE", "lacks its format or its samples"),
        ("drop.wav", b"RIFF\0\0\0\0WAVEjunk", "cannot be read as WAV"),
        ("data.zip", b"PK\3\4\xff\xfe", "a zip archive that cannot be read"),
        ("data.bin", b"\0\1\xff\xfe\1", "neither text nor a WAV"),
    ],
)
def test_what_is_no_sound_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, says: str
) -> None:
    (tmp_path / name).write_bytes(content)
    assert run(["fit", str(tmp_path / name)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search(says, line)


def test_a_knock_stays_where_no_law_fits_the_touches_without_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Touches without a law ended in an AssertionError. A fit fails rarely, so here it is made to."""
    sound, _ = synthesise.drop_recording(
        synthesise.hunt_crossley(0.3), 0.4, 3e-3, "tile", 40, np.random.default_rng(3), seconds=2.0
    )
    recording = Recording("r", sound, 44100)
    band, train = listening._trains(recording)[0]
    whole = listening._Heard.of(band, train, MeasurementSetup(), recording)
    knock = whole.places[0] - 15000
    places = np.array([knock, *whole.places[:5]])
    heard = replace(whole, places=places, numbers=np.arange(6)).fitted()
    assert len(heard.without_knocks().places) == 5

    def fails_without_the_knock(law: Any, sets: Any, reference: float) -> Any:
        if law == LAWS[WITH_E0] and len(sets[0].times) < 6:
            raise FloatingPointError("no noise is likely")
        return fit_law(law, sets, reference)

    monkeypatch.setattr(listening, "fit_law", fails_without_the_knock)
    kept = heard.without_knocks()
    assert len(kept.places) == 6
    assert kept.fit is not None


def test_noise_has_no_train_of_bounces() -> None:
    noise = synthesise.pink_noise(100_000, np.random.default_rng(0)) * 0.1
    with pytest.raises(UserError, match=r"train of bounces|touches"):
        picks = listen(Recording("n", noise, 44100), MeasurementSetup())[0]
        assert len(picks.times) > 3, "touches"


def test_of_a_long_recording_the_part_with_the_bounces_is_read(tmp_path: Path) -> None:
    sound, at = synthesise.drop_recording(
        synthesise.hunt_crossley(0.3), 0.4, 3e-3, "tile", 40, np.random.default_rng(3), seconds=4.0
    )
    noise = 2e-3 * np.random.default_rng(4).standard_normal(70 * 44100)
    noise[50 * 44100 : 50 * 44100 + len(sound)] += sound
    path = wav(tmp_path / "long.wav", "16", noise)
    recording = read_recording(path, quick_score)
    assert len(recording.sound) <= 24 * 44100
    assert listen(recording, MeasurementSetup())[0].times[0] == pytest.approx(
        50.0 + at[0], abs=2e-3
    )
    part = read_recording(path, quick_score, 49.0, 56.0)
    assert len(part.sound) == 7 * 44100
    assert listen(part, MeasurementSetup())[0].times[0] == pytest.approx(50.0 + at[0], abs=2e-3)


def test_a_phones_recording_is_read(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    sound, at = synthesise.drop_recording(
        synthesise.hunt_crossley(0.3), 0.4, 3e-3, "tile", 40, np.random.default_rng(3), seconds=4.0
    )
    with av.open(str(tmp_path / "drop.m4a"), "w") as file:
        stream = file.add_stream("aac", rate=44100)
        for begin in range(0, len(sound), 1024):
            block = sound[None, begin : begin + 1024].astype(np.float32)
            frame = av.AudioFrame.from_ndarray(block, format="fltp", layout="mono")
            frame.rate, frame.pts = 44100, begin
            for packet in stream.encode(frame):
                file.mux(packet)
        for packet in stream.encode(None):
            file.mux(packet)
    found = listen(read_recording(tmp_path / "drop.m4a", quick_score), MeasurementSetup())[0]
    shared = min(8, len(found.times))
    assert np.diff(found.times)[:shared] == pytest.approx(np.diff(at)[:shared], abs=1e-3)
