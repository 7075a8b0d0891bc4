"""Facts of a file that would change its answer: another gravity, a tilt, a moving plate, a push."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from hcbench.fitting.column_names import folded
from hcbench.fitting.read import read_datasets
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from pathlib import Path

H = 92.0 * 0.61 ** np.arange(6)
HEIGHTS = "bounce,height (cm)\n" + "".join(f"{i},{h:.1f}\n" for i, h in enumerate(H, 1))
DROPS = "drop height (cm),rebound height (cm)\n" + "".join(f"{h:.1f},{0.6 * h:.2f}\n" for h in H)
SPEEDS = "v_in (m/s),v_out (m/s)\n" + "".join(f"{h:.2f},{0.8 * h:.2f}\n" for h in H)
OTHER_GRAVITIES = {
    "a number": "# gravity: 3.71",
    "a vector": "# gravity = (0.0, -3.71, 0.0)",
    "a list below": "# world:\n# gravity:\n  - 0\n  - 0\n  - -3.71",
    "a letter": "# Mars, g = 3,71 m/s²",
    "another unit": "# gravitational acceleration 371 cm/s^2",
    "the Earth's": "# local gravity: 0.3783 g",
    "German": "# Schwerkraft: 3,71 m/s²",
    "French": "# gravité (m/s²) : 3,71",
    "Russian": "# ускорение свободного падения 3,71 м/с²",
    "Japanese": "# 重力加速度：３．７１",
}
SAME_GRAVITIES = {
    "a latitude": "# gravity: 9.78",
    "a round number": "# take g = 10 m/s^2",
    "a vector": "# gravity = [0, 0, -9.81]",
    "feet": "# gravity 32.2 ft/s^2",
    "no unit": "# gravity;981",
    "grams": "# mass 45 g: the larger one, m in g: 45",
    "a centre": "# center of gravity: 20 mm",
}


def read(path: Path, text: str, setup: MeasurementSetup | None = None) -> int:
    path.write_text(text, encoding="utf-8")
    return len(read_datasets(path, setup or MeasurementSetup()))


@pytest.mark.parametrize("line", OTHER_GRAVITIES.values(), ids=OTHER_GRAVITIES)
def test_another_gravity_is_asked_for(tmp_path: Path, line: str) -> None:
    path = tmp_path / "data.txt"
    with pytest.raises(UserError, match=r"gravity.*3\.7\d* m/s\^2.*--gravity") as error:
        read(path, f"{line}\n{HEIGHTS}")
    assert error.value.slot == "gravity"
    assert read(path, f"{line}\n{HEIGHTS}", MeasurementSetup(gravity=Known(3.71))) == 1
    # Speeds need no gravity.
    assert read(path, f"{line}\n{SPEEDS}") == 1


@pytest.mark.parametrize("line", SAME_GRAVITIES.values(), ids=SAME_GRAVITIES)
def test_gravity_of_the_earth_is_no_news(tmp_path: Path, line: str) -> None:
    assert read(tmp_path / "data.txt", f"{line}\n{HEIGHTS}") == 1


def test_gravity_in_a_column_is_seen(tmp_path: Path) -> None:
    rows = "".join(f"{h:.1f},{0.6 * h:.2f},1.62\n" for h in H)
    with pytest.raises(UserError, match=r"1\.62 m/s\^2"):
        read(tmp_path / "data.csv", f"drop height (cm),rebound height (cm),gravity (m/s^2)\n{rows}")


@pytest.mark.parametrize(
    "line",
    [
        "the track is tilted by 2.5 degrees",
        "Bahn um 3° geneigt",
        "tilt_deg: 1.5",
        "a glider on an air track",
        "shaker on, 20 Hz",
        "the plate moves up at 0.3 m/s",
        "ball on loudspeaker membrane driven at 35 Hz, amplitude 0.4 mm",
        "ball on a moving plate",
        "the plate was moving",
        "the plate moves up and down",
        "ball on a shaker",
        "a vibrating steel plate",
        "plate driven sinusoidally",
        "ball on a moving plate (amplitude 0.4 mm)",
        "oscillating platform",
        "the table vibrates",
        "Die Platte schwingt",
    ],
)
def test_a_tilt_or_a_moving_plate_refuses_heights(tmp_path: Path, line: str) -> None:
    with pytest.raises(UserError, match=r"vertical fall|plate at rest"):
        read(tmp_path / "data.txt", f"# {line}\n{HEIGHTS}")


@pytest.mark.parametrize(
    "line",
    ["camera tilt 3°", "tilt of the phone: 4 deg", "Kamera um 3° geneigt", "camera_tilt_deg: 2.5"],
)
def test_a_tilted_camera_changes_no_fall(tmp_path: Path, line: str) -> None:
    assert read(tmp_path / "data.txt", f"# {line}\n{HEIGHTS}") == 1
    with pytest.raises(UserError, match="vertical fall"):
        read(tmp_path / "data.txt", f"# {line}, plate tilted by 2 degrees\n{HEIGHTS}")
    with pytest.raises(UserError, match="vertical fall"):
        read(tmp_path / "data.txt", f"# camera on a plate tilted by 3°\n{HEIGHTS}")


def test_speeds_relative_to_a_moving_plate_are_read(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="write 'speeds relative to the plate'"):
        read(tmp_path / "data.txt", f"# vibrating plate\n{SPEEDS}")
    line = "# vibrating plate, speeds relative to the plate\n"
    assert read(tmp_path / "data.txt", line + SPEEDS) == 1
    with pytest.raises(UserError, match="plate at rest"):
        read(tmp_path / "data.txt", line + HEIGHTS)


@pytest.mark.parametrize(
    "line",
    ["dribbled by hand, getting faster", "dribbling", "pushed down by hand at each bounce"],
)
def test_a_ball_that_a_hand_drives_is_refused_but_in_pairs_of_speeds(
    tmp_path: Path, line: str
) -> None:
    with pytest.raises(UserError, match="free bounces"):
        read(tmp_path / "data.txt", f"# {line}\n{HEIGHTS}")
    assert read(tmp_path / "data.txt", f"# {line}\n{SPEEDS}") == 1


@pytest.mark.parametrize(
    "line",
    [
        *(
            "tilt 0.0 deg",
            "initial speed 0 m/s",
            "shaker off",
            "no shaker",
            "no shaker at 50 Hz",
            "shaker: none",
            "2 ramps",
        ),
        *("the table was moved away", "moving average of the floor level", "moving the table away"),
        *(
            "the plate is not moving",
            "the table vibrates at impact",
            "optical table, vibration free",
        ),
        *("ball leaves the floor moving to the right", "clicks picked by hand", "speaker: Anna"),
        "moving_plate: false",
        *("the ball was not dribbled", "plate moved 10 cm to the left between drops"),
    ],
)
def test_nothing_of_it_refuses_nothing(tmp_path: Path, line: str) -> None:
    assert read(tmp_path / "data.txt", f"# {line}\n{DROPS}") == 1


@pytest.mark.parametrize(
    "line",
    [
        *("the ball hops down the stairs", "die Treppe hinunter", "bajando la escalera", "下楼梯"),
        *("Newton's cradle", "height of the splash after each drop of water", "маятник"),
        *("new ball for each bounce", "bei jedem Sprung ein neuer Ball", "cada vez otra pelota"),
        *("caught after each bounce", "每次换球", "each row is a new drop from another height"),
        "rolled off the table after bounce 3",
    ],
)
def test_a_sentence_that_tells_of_something_else_is_named(tmp_path: Path, line: str) -> None:
    with pytest.raises(UserError) as refused:
        read(tmp_path / "data.txt", f"# {line}\n{HEIGHTS}")
    assert folded(line) in refused.value.got
    assert read(tmp_path / "data.txt", f"# {line}\n{SPEEDS}") == 1


@pytest.mark.parametrize(
    "line",
    [
        *("a new ball, bought on Monday", "caught after the last bounce", "no stairs nearby"),
        *("rolled off at the end", "measured in the stairwell", "every bounce was filmed"),
    ],
)
def test_a_sentence_about_the_ball_or_the_room_refuses_nothing(tmp_path: Path, line: str) -> None:
    assert read(tmp_path / "data.txt", f"# {line}\n{HEIGHTS}") == 1


@pytest.mark.parametrize("line", ["read at every second bounce", "jeder zweite Sprung gemessen"])
def test_bounces_that_are_left_out_refuse_heights_without_numbers(
    tmp_path: Path, line: str
) -> None:
    heights = "".join(f"{h:.1f}\n" for h in H)
    with pytest.raises(UserError, match="each bounce"):
        read(tmp_path / "data.txt", f"# {line}\nheight (cm)\n{heights}")
    numbered = "".join(f"{2 * i + 1},{h:.1f}\n" for i, h in enumerate(H))
    assert read(tmp_path / "data.txt", f"# {line}\nbounce,height (cm)\n{numbered}") == 1


def test_a_throw_refuses_where_the_drop_counts(tmp_path: Path) -> None:
    line = "# thrown down with 2 m/s\n"
    with pytest.raises(UserError, match="from rest"):
        read(tmp_path / "data.txt", line + DROPS)
    with pytest.raises(UserError, match="from rest"):
        read(tmp_path / "data.txt", line + HEIGHTS, MeasurementSetup(height=Known(1.5)))
    assert read(tmp_path / "data.txt", line + HEIGHTS) == 1
