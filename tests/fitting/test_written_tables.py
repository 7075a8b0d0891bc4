"""Ways in which programs and people write a table: each read as what it
says, or refused, never misread.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from measured_bounces import EXACT, synthesise

from hcbench.fitting.datasets import Dataset, TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset
from hcbench.fitting.track import Track
from hcbench.system.errors import UserError

T = synthesise.touch_times(
    synthesise.hunt_crossley(0.3), 0.3, 0.0, 0.0, np.random.default_rng(0), 9
)
H = synthesise.bounce_heights(
    synthesise.hunt_crossley(0.3), 0.3, 1e-6, 0.0, np.random.default_rng(0), 9
)
V = np.linspace(0.4, 2.0, 9)
E = np.array([synthesise.hunt_crossley(0.3)(v) for v in V])
FILM = synthesise.track(
    synthesise.hunt_crossley(0.3), 0.5, 1e-3, 1e-4, 120, np.random.default_rng(1)
)


def rows(
    *columns: np.ndarray | list[str], sep: str = ",", comma: bool = False, form: str = ".5f"
) -> str:
    lines = []
    for row in zip(*columns, strict=True):
        cells = [one if isinstance(one, str) else format(one, form) for one in row]
        lines.append(sep.join(c.replace(".", ",") if comma else c for c in cells))
    return "\n".join(lines) + "\n"


N = [str(i) for i in range(9)]
WORDS = ["ok"] * 9
PM = [f"{e:.4f} ± 0.002" for e in E]
TIMES: dict[str, str | bytes] = {
    "plain": "time [s]\n" + rows(T),
    "round brackets": "Time (s)\n" + rows(T),
    "slash": "t/s\n" + rows(T),
    "slash with spaces": "t / s\n" + rows(T),
    "underscore": "time_s\n" + rows(T),
    "comma and unit": '"Time, s"\n' + rows(T),
    "in words": "time in ms\n" + rows(1e3 * T),
    "milliseconds": "time_ms\n" + rows(1e3 * T),
    "numbered rows": "bounce,time [s]\n" + rows(N, T),
    "a note": "time [s],note\n" + rows(T, WORDS),
    "a ball's name": "ball;time [s]\n" + rows(["A"] * 9, T, sep=";"),
    "acoustic stopwatch": '"Event time (s)","Interval (s)"\n'
    + rows(T, np.concatenate([[0], np.diff(T)])),
    "acoustic stopwatch, tabs and commas": "Event time (s)\tInterval (s)\n"
    + rows(T, np.concatenate([[0], np.diff(T)]), sep="\t", comma=True),
    "intervals": "interval [s]\n" + rows(np.diff(T)),
    "intervals, dt": "dt (ms)\n" + rows(1e3 * np.diff(T)),
    "decimal commas": "time [s];bounce\n" + rows(T, N, sep=";", comma=True),
    "one column of decimal commas": "time [s]\n" + rows(T, comma=True),
    "blanks": "time [s]   bounce\n" + rows(T, N, sep="  "),
    "blanks, a name of two words": "impact time [s]  bounce\n" + rows(T, N, sep=" "),
    "Markdown": "| time [s] | bounce |\n|---:|---|\n"
    + rows(["| " + f"{t:.5f}" for t in T], N, sep=" | "),
    "UTF-16 without its mark": ("time [s]\n" + rows(T)).encode("utf-16-le"),
    "UTF-16, big-endian, without its mark": ("time [s]\n" + rows(T)).encode("utf-16-be"),
    "UTF-16": ("time [s]\n" + rows(T)).encode("utf-16"),
    "cp1252": ("time [µs]\n" + rows(1e6 * T)).encode("cp1252"),
    "micro sign": "time [µs]\n" + rows(1e6 * T),
    "units in a line": "time\ns\n" + rows(T),
    "uncertainties in cells": "time [s]\n" + rows([f"{t:.5f} +- 0.0002" for t in T]),
    "Zeit": "Zeit [s]\n" + rows(T),
    "comments": "# from the lab\ntime [s]\n" + rows(T),
}
HEIGHTS: dict[str, str | bytes] = {
    "plain": "height [cm]\n" + rows(1e2 * H),
    "numbered": "bounce,height [cm]\n" + rows(N[: len(H)], 1e2 * H),
    "h/cm": "n;h/cm\n" + rows(N[: len(H)], 1e2 * H, sep=";", comma=True),
    "uncertain": "height [m]\n" + rows([f"{h:.4f} ± 0.001" for h in H]),
}
PAIRS: dict[str, str | bytes] = {
    "plain": "speed [m/s],restitution\n" + rows(V, E),
    "COR": "v_n [m/s],COR\n" + rows(V, E),
    "per cent": "speed [m/s],e [%]\n" + rows(V, 1e2 * E),
    "per cent in cells": "speed [m/s],e\n" + rows(V, [f"{100 * e:.3f} %" for e in E]),
    "plus and minus": "speed [m/s],e\n" + rows(V, PM),
    "digits in brackets": "speed [m/s],e\n" + rows(V, [f"{e:.4f}(20)" for e in E]),
    "a uncertainty's column": "speed [m/s],e,u_e\n" + rows(V, E, np.full(9, 2e-3)),
    "in and out": "v_in [m/s],v_out [m/s]\n" + rows(V, V * E),
    "before and after": "v before [m/s],v after [m/s],trial\n" + rows(V, V * E, N),
    "drop and rebound": "drop height [cm],rebound height [cm]\n"
    + rows(100 * V**2 / 19.6133, 100 * (V * E) ** 2 / 19.6133),
    "impact velocity": "impact velocity (m/s);coefficient of restitution\n" + rows(V, E, sep=";"),
    "units in a line, none for e": "speed,restitution\nm/s,\n" + rows(V, E),
    "units in a line, a dash for e": "speed;e\n[m/s];[-]\n" + rows(V, E, sep=";"),
    "a dash for e": "speed [m/s],e [-]\n" + rows(V, E),
    "comments after numbers": "speed [m/s],e\n"
    + rows(V, [f"{e:.5f}  # trial {i}" for i, e in enumerate(E)]),
    "semicolons and commas": "v/(m/s);e\n" + rows(V, E, sep=";", comma=True),
}
TRACKS: dict[str, str | bytes] = {
    "plain": "time [s],height [m]\n" + rows(*FILM),
    "t, x and y": "t [s],x [m],y [m]\n" + rows(FILM[0], 0 * FILM[0], FILM[1]),
    "y downwards": "t [s],y [m]\n" + rows(FILM[0], 0.6 - FILM[1]),
    "Tracker": "mass A\t\t\nt\tx\ty\n" + rows(FILM[0], 0 * FILM[0], FILM[1], sep="\t"),
    "Tracker, commas": "mass A,,\nt,x,y\n" + rows(FILM[0], 0 * FILM[0], FILM[1]),
    "Tracker with units": "mass A\t\t\nt (s)\tx (m)\ty (m)\n"
    + rows(FILM[0], 0 * FILM[0], FILM[1], sep="\t"),
    "Logger Pro": "Time\tPosition\nt\ty\ns\tm\n" + rows(*FILM, sep="\t"),
    "Vernier": "Latest: Time (s),Latest: Position (m)\n" + rows(*FILM),
}
KINDS = {"times": TIMES, "heights": HEIGHTS, "pairs": PAIRS, "track": TRACKS}
ALL = [(kind, name, content) for kind, each in KINDS.items() for name, content in each.items()]


def is_right(data: Dataset, kind: str) -> bool:
    if kind == "times":
        return isinstance(data, TouchTimes) and np.allclose(
            np.diff(data.times), np.diff(T), atol=2e-5
        )
    if kind == "heights":
        return isinstance(data, Heights) and np.allclose(data.heights, H, atol=2e-4)
    if kind == "pairs":
        return (
            isinstance(data, SpeedPairs)
            and np.allclose(data.restitution, E, atol=2e-4)
            and np.allclose(data.speed, V, atol=1e-3)
        )
    return isinstance(data, Track) and data.drop is not None and abs(data.drop - 0.5) < 5e-3


@pytest.mark.parametrize(("kind", "name", "content"), ALL, ids=[f"{k}: {n}" for k, n, _ in ALL])
def test_a_table_is_read_as_it_says(
    tmp_path: Path, kind: str, name: str, content: str | bytes
) -> None:
    path = tmp_path / "data.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert is_right(read_dataset(path, EXACT), kind)


@pytest.mark.parametrize(
    "text",
    [
        "time [s],temperature [K]\n0,1\n0.3,1\n0.5,1\n0.6,1\n",  # a log of something else
        "frame,y [px]\n" + rows(N, H * 1e3),
        "time,height\n" + rows(FILM[0], 1e2 * FILM[1]),
        "speed [m/s],e\n" + rows(V, E) + "1_0,0.5\n",
        "speed [m/s],e\n" + rows(V, E) + f"{'1' * 140_000},0.5\n",
    ],
)
def test_what_may_be_something_else_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(UserError):
        read_dataset(tmp_path / "data.csv", EXACT)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('speed [mm/s],e\n"1,050",0.8259\n"1,256",0.7985\n', "'1,050' and '0.8259'"),
        ("speed [mm/s];e\n1.050;0,8259\n1.256;0,7985\n", "'0,8259' and '1.050'"),
        ("time [ms]\n1,769\n2,351\n2,718\n", "expected 1769 or 1.769"),
        ("time [us]\n176,905\n235,075\n271,837\n", "expected 176905 or 176.905"),
    ],
)
def test_a_sign_that_may_part_thousands_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(UserError, match=re.escape(said)):
        read_dataset(tmp_path / "data.csv", EXACT)


def test_a_comma_is_a_decimal_sign_where_one_number_of_the_file_says_so(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("time [s]\n0,443\n0,842\n1,201\n1,524\n")
    (tmp_path / "points.csv").write_text("time [s]\n0.443\n0.842\n1.201\n1.524\n")
    with_commas = read_dataset(tmp_path / "data.csv", EXACT)
    with_points = read_dataset(tmp_path / "points.csv", EXACT)
    assert isinstance(with_commas, TouchTimes) and isinstance(with_points, TouchTimes)
    assert with_commas.times.tolist() == with_points.times.tolist()


@pytest.mark.parametrize(
    "text",
    [
        "speed [mm/s];e\n922;0,8432\n1.067;0,8259\n1.212;0,8071\n",
        'speed [mm/s],e\n922,0.8432\n"1,067",0.8259\n"1,212",0.8071\n',
        "speed [mm/s]\te\n922.0\t0.8432\n1,067.0\t0.8259\n1,212.0\t0.8071\n",
    ],
)
def test_thousands_are_parted_where_a_number_of_the_column_says_so(
    tmp_path: Path, text: str
) -> None:
    (tmp_path / "data.csv").write_text(text)
    read = read_dataset(tmp_path / "data.csv", EXACT)
    assert read.pairs()[0] == pytest.approx([0.922, 1.067, 1.212])


@pytest.mark.parametrize(
    "text",
    [
        "# speed [m/s],restitution\n" + rows(V, E),  # numpy.savetxt
        "# made by hand\n# speed [m/s];restitution\n" + rows(V, E).replace(",", ";"),
        ",speed [m/s],restitution\n"
        + rows([str(i) for i in range(len(V))], V, E),  # pandas, with its index
        "#,speed [m/s],restitution\n" + rows([str(i + 1) for i in range(len(V))], V, E),
    ],
)
def test_headers_of_numpy_and_pandas_are_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "data.csv").write_text(text)
    assert is_right(read_dataset(tmp_path / "data.csv", EXACT), "pairs")


def test_a_comment_over_numbers_is_not_a_header(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text("# measured on Monday, by Ann\n" + rows(V, E, E))
    with pytest.raises(UserError, match="a header"):
        read_dataset(tmp_path / "data.csv", EXACT)
