"""Files as programs write them, with their own names, units and lines before the table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from measured_bounces import EXACT
from table_dialects import data, workbook

from hcbench.fitting import read
from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.read import read_dataset, read_datasets
from hcbench.fitting.track import Track

T = data("times")[0].values
FILM = [column.values for column in data("track")]
PULSE = [column.values for column in data("force")]
FRAMES = range(len(FILM[0]))
NOW = 1_620_000_000


def lines(*head: str, rows: list[str]) -> str:
    return "\n".join([*head, *rows]) + "\n"


def film(form: str) -> list[str]:
    return [form.format(i=i, t=t, y=y, mm=1e3 * y) for i, t, y in zip(FRAMES, *FILM, strict=True)]


def clock(seconds: float) -> str:
    return f"{int(seconds // 60)}:{seconds % 60:06.3f}"


def stamp(seconds: float) -> int:
    return NOW * 10**9 + round(1e9 * seconds)


TIMES = {
    "Audacity": lines(rows=[f"{t:.6f}\t{t:.6f}\t{i}" for i, t in enumerate(T, 1)]),
    "Audacity, words": lines(rows=[f"{t:.6f}\t{t + 0.01:.6f}\tbounce" for t in T]),
    "Audacity, frequencies": lines(rows=[f"{t:.6f}\t{t:.6f}\thit\n\\\t100.0\t2000.0" for t in T]),
    "Reaper": lines(
        "#,Name,Start,End,Length,Color", rows=[f"M{i},,{clock(t)},,," for i, t in enumerate(T, 1)]
    ),
    "Sonic Visualiser": lines(rows=[f"{t:.9f},New Point" for t in T]),
    "Sonic Visualiser, times": lines(rows=[f"{t:.9f}" for t in T]),
    "Sonic Visualiser, layer": '<?xml version="1.0"?><!DOCTYPE sonic-visualiser><sv><data>'
    '<model id="1" name="" sampleRate="44100" type="sparse" dimensions="1"/><dataset id="0" dimensions="1">'
    + "".join(f'<point frame="{round(44100 * t)}" label="New Point"/>' for t in T)
    + "</dataset></data></sv>",
    "phyphox, stopwatch": lines(
        ",".join(['"Start (s)"', *(f'"Stop {i} (s)"' for i in range(1, 11))]),
        rows=[",".join([*(f"{t:.9E}" for t in T), "0.0E0", "0.0E0"])],
    ),
    "samples and their rate": lines(
        "# sample rate: 48000 Hz", "sample", rows=[str(round(48000 * t)) for t in T]
    ),
    "frames and their rate": lines(
        "fps,10000", "bounce,frame", rows=[f"{i},{round(1e4 * t)}" for i, t in enumerate(T)]
    ),
    "one line": "times in s: " + ", ".join(f"{t:.5f}" for t in T) + "\n",
    "time stamps": lines(
        "no,timestamp", rows=[f"{i},2024-03-05T10:20:{t + 5:09.6f}" for i, t in enumerate(T)]
    ),
}
TRACKS = {
    "Tracker": lines("mass_A\t\t", "t\tx\ty", rows=film("{t:.6E}\t0.0E0\t{y:.6E}")),
    "Tracker, commas": lines("mass A,,", "t,x,y", rows=film("{t:.6f},0.0,{y:.6f}")),
    "Kinovea": lines(
        "#Kinovea Trajectory data export", "#T X Y", "", rows=film("{t:.5f} 0.10 {y:.5f}")
    ),
    "Kinovea, table": lines(
        "Time (ms),Ball/0/X (cm),Ball/0/Y (cm)",
        rows=[f"{1e3 * t:.3f},1.0,{100 * y:.4f}" for t, y in zip(*FILM, strict=True)],
    ),
    "OpenCV": lines(
        "frame,time_s,cx_m,cy_m",
        rows=[f"{i},{t:.6f},0.2,{0.9 - y:.6f}" for i, t, y in zip(FRAMES, *FILM, strict=True)],
    ),
    "Vicon": lines(
        "Trajectories",
        "120",
        ",,Ball:Ball1,,",
        "Frame,Sub Frame,X,Y,Z",
        ",,mm,mm,mm",
        rows=film("{i},0,12.5,-3.1,{mm:.4f}"),
    ),
    "OptiTrack": lines(
        "Format Version,1.23,Take Name,Take 1,Capture Frame Rate,120.000000,"
        "Rotation Type,Quaternion,Length Units,Meters",
        "",
        ",,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body",
        ",,Ball,Ball,Ball,Ball,Ball,Ball,Ball",
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z",
        rows=film("{i},{t:.6f},0.0,0.0,0.0,1.0,0.1,{y:.6f},0.2"),
    ),
    "ROS": lines(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.pose.position.x,"
        "field.pose.position.y,field.pose.position.z,field.pose.orientation.w",
        rows=[
            f"{stamp(t) + 900},{i},{stamp(t)},world,0.1,0.2,{y:.6f},1.0"
            for i, t, y in zip(FRAMES, *FILM, strict=True)
        ],
    ),
    "ROS, echo": "".join(
        f"header:\n  seq: {i}\n  stamp:\n    secs: {NOW + int(t)}\n    nsecs: {round(1e9 * (t % 1))}\n"
        '  frame_id: "world"\n'
        f"pose:\n  position:\n    x: 0.1\n    y: 0.2\n    z: {y:.6f}\n---\n"
        for i, t, y in zip(FRAMES, *FILM, strict=True)
    ),
    "MuJoCo": lines(
        "time,qpos[0],qpos[1],qpos[2],qvel[2],ncon", rows=film("{t:.6f},0.0,0.0,{y:.6f},0.1,0")
    ),
    "MuJoCo, short names": lines("time z vz", rows=film("{t:.6f} {y:.6f} 0.1")),
    "Capstone": lines(
        "Time (s) Run #1,Position (m) Run #1,Velocity (m/s) Run #1",
        rows=film("{t:.6f},{y:.6f},0.1"),
    ),
    "Vernier": lines(
        '"Data Set 1:Time(s)","Data Set 1:Position(m)","Data Set 1:Velocity(m/s)"',
        rows=film("{t:.6f},{y:.6f},0.1"),
    ),
    "frames and their rate": lines("# fps = 120", "frame;height [m]", rows=film("{i};{y:.6f}")),
}
FORCES = {
    "Kistler": lines(
        "BioWare 5.4",
        "Name:\tDrop 3",
        "Date:\t05.03.2024",
        "",
        "abs time (s)\tFx\tFy\tFz\t|Ft|\tAx\tAy",
        "s\tN\tN\tN\tN\tm\tm",
        rows=[
            f"{t:.6f}\t0.1\t0.2\t{f:.4f}\t{f:.4f}\t0.0\t0.0" for t, f in zip(*PULSE, strict=True)
        ],
    ),
    "AMTI": lines(
        "AMTI NetForce",
        "Sample rate (Hz),100000",
        "Fx (N),Fy (N),Fz (N),Mx (N*m),My (N*m),Mz (N*m)",
        rows=[f"0.1,0.2,{-f:.4f},0,0,0" for f in PULSE[1]],
    ),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_of_touches_are_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / "data.txt"
    path.write_text(TIMES[name], encoding="utf-8")
    found = read_dataset(path, EXACT)
    assert isinstance(found, TouchTimes)
    assert np.diff(found.times) == pytest.approx(
        np.diff(T), abs=1.1e-3 if "Reaper" in name else 1.1e-4
    )


@pytest.mark.parametrize("name", TRACKS)
def test_tracks_are_read(tmp_path: Path, name: str) -> None:
    path = tmp_path / "data.csv"
    path.write_text(TRACKS[name], encoding="utf-8")
    found = read_dataset(path, EXACT)
    assert isinstance(found, Track) and found.drop is not None
    assert found.drop == pytest.approx(0.5, abs=5e-3)
    assert np.median(np.diff(found.times)) == pytest.approx(1 / 120, rel=1e-3)


@pytest.mark.parametrize("name", FORCES)
def test_forces_are_read(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "data.txt"
    path.write_text(FORCES[name], encoding="utf-8")
    pulses: list[tuple[np.ndarray, np.ndarray]] = []
    monkeypatch.setattr(read, "fit_pulse", lambda _, setup, t, f: pulses.append((t, f)))
    read.read_force(path, EXACT)
    ((times, force),) = pulses
    assert times - times[0] == pytest.approx(PULSE[0], abs=1e-9)
    assert force == pytest.approx(PULSE[1], abs=1e-3)


def test_a_workbook_may_have_a_drop_in_each_sheet_and_several_in_one(tmp_path: Path) -> None:
    one = [["Event time (s)", "Interval (s)"], *([repr(t), "0.1"] for t in T.tolist())]
    two = [
        [*a, "", *b]
        for a, b in zip(one, [one[0], *([repr(2 * t), "0.1"] for t in T.tolist())], strict=True)
    ]
    (tmp_path / "drops.xlsx").write_bytes(
        workbook({"80 cm": one, "90 cm": two, "Device": [["version", "1.1"]]})
    )
    found = read_datasets(tmp_path / "drops.xlsx", EXACT)
    # The first drop of the second sheet is the first sheet's.
    assert [data.name.rpartition(", ")[2] for data in found] == ["80 cm", "drop 2"]
