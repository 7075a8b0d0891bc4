"""Chats, notebooks, logs and program text: numbers whose places repeat are read; others are refused."""

from __future__ import annotations

import json
import quopri
from typing import TYPE_CHECKING

import numpy as np
import pytest
from measured_bounces import EXACT

from hcbench.fitting.datasets import TouchTimes
from hcbench.fitting.heights import Heights, SpeedPairs
from hcbench.fitting.read import read_dataset, read_datasets
from hcbench.system.errors import UserError

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

T = 0.7 + np.concatenate([[0.0], np.cumsum(0.62 * 0.8 ** np.arange(8))])
H = 48.0 * 0.66 ** np.arange(6)
V = 4.2 * 0.8 ** np.arange(7)
NTH = ("primo", "secondo", "terzo", "quarto", "quinto", "sesto")


def lines(form: str, values: Sequence[float] | np.ndarray = T) -> str:
    return "".join(
        form.format(i=i, x=x, ms=1e3 * x, us=1e6 * x, after=0.8 * x) + "\n"
        for i, x in enumerate(values, 1)
    )


OF_TIMES = {
    "C": "/* TIM2 */\n#define N 9\nstatic const uint32_t impact_us[N] = {\n" + lines("{us:.0f}u,") + "};\n",
    "notebook": json.dumps(
        {
            "cells": [
                {"source": ["impact_times"], "outputs": [{"text": [f"array({[*map(float, T)]})"]}]}
            ],
            "nbformat": 4,
        },
        indent=1,
    ),
    "mail": "On 14 Nov 2023, Owen wrote:\n> the clicks, in seconds from the start:\n>\n"
    + lines("> click {i}   {x:.4f}")
    + ">\n> cheers, Owen\n",
    "log of a phone": "11-14 10:15:01.977  4312 D BallSensor: armed\n"
    + lines("11-14 10:15:0{x:.3f}  4312 I BallSensor: impact #{i} peak={after:.1f} m/s^2")
    + "11-14 10:15:09.120  4312 D BallSensor: stopped\n",
    "lyrics": "[ti:drop]\n" + lines("[00:0{x:.3f}]bounce {i}"),
    "dict": f"touch_times = {dict(enumerate(map(float, T), 1))}\n",
    "another number": "bounce_no | t_ms | peak_mv\n" + lines("{i} | {ms:.1f} | {after:.0f}"),
    "a unit in words": "-- touches of the ball, in ms\n" + lines("{{ n = {i}, time = {ms:.1f} }},"),
    "a row twice": "touch,time (s)\n" + lines("{i},{x:.4f}", T[:4]) + f"4,{T[3]:.4f}\n"
    + "".join(f"{i},{x:.4f}\n" for i, x in enumerate(T[4:], 5)),
    "frames": "Film with 240 images/s\nbote  fotograma del contacto\n"
    + "".join(f"{i} {round(240 * x)}\n" for i, x in enumerate(T)),
    "ordinals": "odskok;čas [s]\n"
    + "".join(f"{i}.;{x:.4f}".replace(".", ",").replace(",;", ".;") + "\n" for i, x in enumerate(T, 1)),
    "labels among others": "0.100000\t0.400000\tvoices\n" + lines("{x:.6f}\t{x:.6f}\tclick {i}")
    + "9.000000\t9.500000\tchair\n",
    "constants with remarks": "const unsigned long impact_us[] PROGMEM = {\n"
    + lines("  {us:.0f}UL,  /* nr. {i} */") + "};\n",
    "stamps of ISO": "2025-01-05T08:59:57.100000Z node7-12 WARN boot: ok\n"
    + "2025-01-05T09:00:00.100000Z node7-12 DEBUG alive temp=21.4\n" * 2
    + lines("2025-01-05T09:00:0{x:.6f}Z node7-12 INFO  mic: IMPACT k={i}")
    + "2025-01-05T09:00:09.100000Z node7-12 DEBUG alive temp=21.4\n",
    "titles among others": "1\n00:00:00,100 --> 00:00:00,500\nA ball of glass\n\n"
    + lines("{i}\n00:00:0{x:.3f} --> 00:00:0{x:.3f}\n*knock* impact {i}\n")
    + "12\n00:00:09,000 --> 00:00:09,900\nThank you\n",
    "wide signs": "".join(
        f"　{i}回目の接触　　{1e3 * x:.1f}　ミリ秒\n".translate({k: 0xFEE0 + k for k in range(46, 58)})
        for i, x in enumerate(T, 1)
    ),
}  # fmt: skip
OF_FLIGHTS = {
    "numbered flights and their total": "volo n.;durata [ms]\n"
    + lines("{i};{ms:.1f}", np.diff(T))
    + f"in tutto;{1e3 * np.ptp(T):.1f}\n",
    "Go": "// time in the air after each bounce\nvar flights = []time.Duration{\n"
    + lines("\t{us:.0f} * time.Microsecond,", np.diff(T))
    + "}\n",
    "Fortran": "! in ms\nreal :: flight_ms(8) = (/ &\n"
    + ", &\n".join(f"{1e3 * x:.1f}" for x in np.diff(T))
    + " /)\n",
}
OF_HEIGHTS = {
    "chat": "[12/03/24, 10:14:07] Luca: lascio la pallina\n"
    + "".join(
        f"[12/03/24, 10:1{i}:11] Sara: {nth} rimbalzo: {h:.1f} cm\n".replace(".", ",")
        for i, (nth, h) in enumerate(zip(NTH, H, strict=True), 4)
    )
    + "[12/03/24, 10:24:40] Luca: grazie\n",
    "messages in JSON": json.dumps(
        [
            {"id": 7919 * i, "timestamp": f"2025-03-01T10:{i}:00+00:00", "content": f"bounce {i}: {h:.1f} cm"}
            for i, h in enumerate(H, 10)
        ],
        indent=1,
    ),
    "a list in YAML": "висоти_відскоків:   # см\n" + lines("  - {x:.1f}", H),
    "sections": "[atšokimo aukštis]\n" + lines("atšokimas_{i} = {x:.1f} cm", H),
    "Rust": f"let heights_cm: Vec<f64> = vec![{', '.join(f'{h:.1f}' for h in H)}];\n",
    "at rest in the end": "bounce,height (cm)\n" + lines("{i},{x:.1f}", [*H, 0.0]),
    "rows of a matrix": "# name: rebound_heights_cm\n# type: matrix\n# columns: 1\n" + lines(" {x:.1f}", H),
    "vowels about letters": "".join(
        f"{nth} टप्पा — {h:.1f} सेमी\n".translate({48 + k: 0x966 + k for k in range(10)})
        for nth, h in zip(("पहला", "दूसरा", "तीसरा", "चौथा", "पाँचवाँ", "छठा"), H, strict=True)
    ),
    "a coded mail": "From: a@example.org\nMIME-Version: 1.0\nContent-Type: text/plain; charset=utf-8\n"
    "Content-Transfer-Encoding: quoted-printable\n\n"
    + quopri.encodestring(
        "Voilà les hauteurs, après chaque rebond, de la bille lâchée à côté de la fenêtre :\n".encode()
        + b"\n1er rebond : 48.0 cm\n"
        + "".join(f"{i}e rebond : {h:.1f} cm\n" for i, h in enumerate(H[1:], 2)).encode()
        + "\nà bientôt\n".encode()
    ).decode(),
    "SQL in a line": "CREATE TABLE `r` (\n  `nr` int NOT NULL,\n  `hoehe_cm` decimal(5,1)\n);\n"
    + "INSERT INTO `r` VALUES "
    + ",".join(f"({i},{h:.1f})" for i, h in enumerate(H, 1)) + ";\n",
    "a unit that ends with a point": "bounce;height (cm.)\n" + lines("{i};{x:.1f}", H),
    "SQL": "CREATE TABLE d (nomer INT, vysota_cm NUMERIC(6,1));\nINSERT INTO d (nomer, vysota_cm) VALUES\n"
    + lines("  ({i}, {x:.1f}),", H).rstrip(",\n")
    + ";\n",
}  # fmt: skip
OF_SPEEDS = {
    "units below a number": "SHOT   IMPACT VEL   REBOUND VEL\nNO.      (FT/S)        (FT/S)\n"
    + lines("  {i}    {x:.4f}     {after:.4f}", V / 0.3048),
    "game log": "Physics.gravity = (0.00, -9.81, 0.00)\n"
    + lines(
        "[ {i}.674] Probe: Enter with Floor, impact speed {x:.4f} m/s\n"
        "[ {i}.694] Probe: Exit from Floor, rebound speed {after:.4f} m/s",
        V,
    ),
    "signed": lines("bounce #{i} vy: -{x:.4f} -> {after:.4f} m/s", V),
    "attributes": lines(
        '<hit nr="{i}">\n<v_in unitate="m/s">{x:.4f}</v_in>\n'
        '<v_out unitate="m/s">{after:.4f}</v_out>\n</hit>',
        V,
    ),
}
ALL = {
    **{name: (text, np.diff(T)) for name, text in (OF_TIMES | OF_FLIGHTS).items()},
    **{name: (text, 0.01 * H) for name, text in OF_HEIGHTS.items()},
    **{name: (text, V) for name, text in OF_SPEEDS.items()},
}


@pytest.mark.parametrize(("text", "values"), ALL.values(), ids=ALL)
def test_what_people_have_is_read(tmp_path: Path, text: str, values: np.ndarray) -> None:
    path = tmp_path / "data.txt"
    path.write_text(text, encoding="utf-8")
    found = read_dataset(path, EXACT)
    if isinstance(found, TouchTimes):
        given = np.diff(found.times)
    elif isinstance(found, Heights):
        given = found.heights
    else:
        assert isinstance(found, SpeedPairs)
        np.testing.assert_allclose(found.restitution, 0.8, atol=1e-3)
        given = found.speed
    coarse = 1 / 240 if "images/s" in text else 1e-3
    np.testing.assert_allclose(given, values, atol=1.1 * coarse)


REFUSED = {
    "two balls in turn": lines("ball A: bounce {x:.1f} cm\nball B: bounce {after:.1f} cm", H),
    "two balls in a row": lines("ball A bounce {i}: {x:.1f} cm\nball B bounce {i}: {after:.1f} cm", H),
    "one ball, then the other": lines("red ball, bounce {i}: {x:.1f} cm", H)
    + lines("blue ball, bounce {i}: {after:.1f} cm", H),
    "heights lost": lines("[lost] height: {x:.1f} cm", H),
    "half flights": f"const half = {{ flight: {[*map(float, np.diff(T))]} }}; // s\n",
    "rows of another thing": lines("apex {i} at t={x:.3f} s"),
    "times of apexes": json.dumps({"apex": {"time_s": [*map(float, T)]}}),
    "heights over a temperature": "temperature (C),height (cm)\n" + lines("{i},{x:.1f}", H),
    "heights over a mass": "bounce,mass (g),height (cm)\n" + lines("{i},2{i},{x:.1f}", H),
    "pupils": "pupil,bounce height (cm)\n"
    + "".join(f"{name},{x:.1f}\n" for name, x in zip(NTH, H, strict=True)),
    "the unit of something else": "diameter (cm): 6.7\n\nbounce,height\n" + lines("{i},{x:.1f}", H),
    "a quantity doubled": lines("bounce {i}: 2h = {x:.1f} cm", H),
    "laps that get shorter": lines("Lap {i}: 0:{x:05.2f}", H),
    "a minute apart": "touch,time (s)\n" + lines("{i},{us:.0f}"),
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
def test_what_looks_like_bounces_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "data.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError):
        read_datasets(path, EXACT)


def test_drops_beside_each_other_have_a_wider_header(tmp_path: Path) -> None:
    path = tmp_path / "drops.csv"
    path.write_text(
        "Lab 3,,,\nBounce #,Trial 1 (in),Trial 2 (in),Average (in)\n"
        + lines("{i},{x:.3f},{after:.3f},", H)
    )
    first, second = read_datasets(path, EXACT)
    assert isinstance(first, Heights) and isinstance(second, Heights)
    np.testing.assert_allclose(first.heights, 0.0254 * H, atol=1e-4)
    np.testing.assert_allclose(second.heights, 0.0254 * 0.8 * H, atol=1e-4)


def test_rebounds_of_one_drop_are_no_successive_ones(tmp_path: Path) -> None:
    path = tmp_path / "drops.md"
    rows = "".join(f"| {h:.2f} | {0.64 * h:.2f} | {0.65 * h:.2f} | {0.63 * h:.2f} |\n" for h in H)
    path.write_text(
        f"| drop height (cm) | bounce height 1 (cm) | bounce height 2 (cm) | bounce height 3 (cm) |\n"
        f"|---|---|---|---|\n{rows}"
    )
    found = read_dataset(path, EXACT)
    assert isinstance(found, SpeedPairs)
    assert len(found.speed) == 3 * len(H)
    np.testing.assert_allclose(found.restitution, 0.8, atol=0.01)
