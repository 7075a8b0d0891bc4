"""Statements of a text about its numbers: a scale, a decimal sign, a unit, who reads them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import G, synthesise

from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.fitting.track import Track
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

    from hcbench.fitting.datasets import Dataset

H = 48.0 * 0.66 ** np.arange(6)
BOUNCES = "bounce,height (cm)\n" + "".join(f"{i},{h:.1f}\n" for i, h in enumerate(H, 1))
# Metres of a pixel of FILM.
SCALE = 0.8e-3


def film(above: str, rate: int = 240) -> str:
    """A track in pixels from the top of the picture, below a line."""
    fall = np.sqrt(2.0 * 0.7 / G.value)
    t = np.arange(0.0, 1.9, 1.0 / rate)
    y, touch, launch = 0.7 - 0.5 * G.value * t**2, fall, 0.8 * fall * G.value
    while touch < t[-1]:
        y = np.where(t > touch, launch * (t - touch) - 0.5 * G.value * (t - touch) ** 2, y)
        touch, launch = touch + 2.0 * launch / G.value, 0.8 * launch
    rows = "".join(f"{i},{900.0 - h / SCALE:.1f}\n" for i, h in enumerate(y))
    return f"# {rate} fps\n# {above}\nframe,y_px\n{rows}"


def read(path: Path, text: str, mass: Known | None = None) -> Dataset:
    path.write_text(text, encoding="utf-8")
    return read_dataset(path, MeasurementSetup(mass=mass))


@pytest.mark.parametrize(
    "scale",
    [
        "scale: 1 px = 0.8 mm",
        "1 m = 1250 px",
        "1250 px/m",
        "calibration 0.8 mm/px",
        "pixels_per_metre: 1250",
        "mm per pixel = 0,8",
        "1250 pixels correspond to 100 cm",
    ],
)
def test_a_film_in_pixels_has_the_scale_that_its_text_states(tmp_path: Path, scale: str) -> None:
    track = read(tmp_path / "film.csv", film(scale))
    assert isinstance(track, Track)
    assert track.drop == pytest.approx(0.7, rel=0.02)


@pytest.mark.parametrize("scale", ["by hand", "1 px = 0.8 mm; later 1 px = 0.7 mm"])
def test_pixels_without_one_scale_are_scaled_by_their_fall(tmp_path: Path, scale: str) -> None:
    track = read(tmp_path / "film.csv", film(scale))
    assert isinstance(track, Track)
    assert track.drop == pytest.approx(0.7, rel=0.02)
    assert "no scale is given: 1 px is 0.8" in track.assumed


def test_a_wrong_scale_is_seen_by_g(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="times the g given"):
        read(tmp_path / "film.csv", film("1 px = 1.1 mm"))


def test_numbers_with_units_in_the_text_tell_the_decimal_sign(tmp_path: Path) -> None:
    table = "v in (m/s);v out (m/s)\n4,116;3,313\n3,239;2,776\n2,297;2,070\n"
    with pytest.raises(UserError, match="whichever it is"):
        read(tmp_path / "v.csv", table)
    pairs = read(tmp_path / "v.csv", f"Kugel 25,0 mm\n{table}")
    assert isinstance(pairs, SpeedPairs)
    assert pairs.speed[0] == pytest.approx(4.116)


@pytest.mark.parametrize("line", ["all heights in inches", "Höhen in mm abgelesen"])
def test_a_line_that_names_another_unit_than_the_header_refuses(tmp_path: Path, line: str) -> None:
    with pytest.raises(UserError, match=r"'height' in cm, and .*one unit"):
        read(tmp_path / "h.csv", f"# {line}\n{BOUNCES}")


@pytest.mark.parametrize(
    "line",
    ["all heights in centimetres", "ball diameter in mm", "the drop was from a height in feet"],
)
def test_a_line_about_the_same_unit_or_another_thing_refuses_nothing(
    tmp_path: Path, line: str
) -> None:
    assert isinstance(read(tmp_path / "h.csv", f"# {line}\n{BOUNCES}"), Heights)


def chat(*messages: str) -> str:
    who = ("Mia", "Tom")
    return "".join(f"[10:{i:02d}] {who[i % 2]}: {one}\n" for i, one in enumerate(messages))


NTH = ("first", "second", "third", "fourth")


def test_a_chat_of_two_who_count_on_is_one_ball(tmp_path: Path) -> None:
    messages = [f"{nth} bounce got to {h:.1f} cm" for nth, h in zip(NTH, H, strict=False)]
    found = read(tmp_path / "chat.txt", chat("ready?", "yes", *messages))
    assert isinstance(found, Heights)
    assert found.heights == pytest.approx(H[:4] / 100, abs=1e-3)


def test_a_chat_of_several_balls_is_refused(tmp_path: Path) -> None:
    colours = ("red", "blue", "green", "white")
    messages = [f"{one} got to {h:.1f} cm" for one, h in zip(colours, H, strict=False)]
    with pytest.raises(UserError):
        read(tmp_path / "chat.txt", chat(*messages))


@pytest.mark.parametrize("ball", ["", " of my ball", " of the {} ball"])
def test_a_chat_of_two_who_each_measure_is_refused(tmp_path: Path, ball: str) -> None:
    messages = [
        f"{nth} bounce{ball.format(colour)} {h - less:.1f} cm"
        for nth, h in zip(NTH, H, strict=False)
        for colour, less in (("red", 0.0), ("blue", 2.0))
    ]
    with pytest.raises(UserError):
        read(tmp_path / "chat.txt", chat(*messages))


def test_energies_are_speeds_of_a_known_mass(tmp_path: Path) -> None:
    text = "Kugel: 24,5 g\nE before (mJ);E after (mJ)\n110,25;47,7\n47,70;26,41\n26,41;16,99\n"
    with pytest.raises(UserError, match=r"give --mass '24\.5 g'"):
        read(tmp_path / "e.csv", text)
    pairs = read(tmp_path / "e.csv", text, mass=Known(0.0245))
    assert isinstance(pairs, SpeedPairs)
    assert pairs.speed[0] == pytest.approx(3.0)
    assert pairs.restitution[0] == pytest.approx(np.sqrt(47.7 / 110.25))


def test_accelerations_are_no_heights(tmp_path: Path) -> None:
    rows = "".join(f"{0.002 * i:.3f},9.80{i % 7},0.0{i % 5},0.01\n" for i in range(40))
    with pytest.raises(UserError, match="accelerations in the columns z, y, x"):
        read(tmp_path / "a.csv", f"seconds_elapsed,z,y,x\n{rows}")


def test_heights_of_the_balls_top_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="bottom of the ball"):
        read(tmp_path / "h.csv", f"# height of the TOP of the ball\n{BOUNCES}")
    assert read(tmp_path / "h.csv", f"# bottom, not the top of the ball\n{BOUNCES}")


def test_a_list_behind_a_bracket_keeps_its_first_number(tmp_path: Path) -> None:
    heights = ", ".join(f"{h:.1f}" for h in H)
    found = read(tmp_path / "b.R", f"b <- data.frame(\n  n = 1:6,\n  height_cm = c({heights})\n)\n")
    assert isinstance(found, Heights)
    assert len(found.heights) == len(H)


def test_times_to_a_hundredth_scatter_by_their_rounding(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    times = synthesise.touch_times(
        synthesise.constant(0.85), drop=0.9, rng=rng, timing=8e-3, scatter=1e-3, most=9
    )
    text = "time [s]\n" + "".join(f"{t:.2f}\n" for t in times)
    assert read(tmp_path / "t.csv", text).noise_scale == pytest.approx(3e-3)
