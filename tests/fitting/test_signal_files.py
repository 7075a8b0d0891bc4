"""Signals over time, as plates, oscilloscopes, phones and microcontrollers write them."""

from __future__ import annotations

import itertools
import zipfile
from pathlib import Path

import numpy as np
import pytest
from measured_bounces import G, synthesise, write

import hcbench as hb
from hcbench.cli import run
from hcbench.fitting.signals import evened, signal_in
from hcbench.system.errors import UserError

ALPHA = 0.2


def impacts(seed: int, count: int, contact: float, drop: float = 0.5) -> np.ndarray:
    """Rows of begin, s, speeds in and out, m/s, and duration, s, of impacts: the first at 0.4 s."""
    rng = np.random.default_rng(seed)
    rows = []
    at = 0.4
    law = synthesise.hunt_crossley(ALPHA)
    for speed, launch, aloft in itertools.islice(synthesise.flights(law, drop, 2e-3, rng), count):
        lasts = contact * (speed / 3.0) ** -0.2
        rows.append((at, speed, launch, lasts))
        at += lasts + aloft
    return np.array(rows)


def pushes(rows: np.ndarray, rate: float, mass: float = 1.0) -> np.ndarray:
    """Force of impacts at each sample, its mean over the sample: impulses are m (v + v')."""
    fine = 16
    t = np.arange(round((rows[-1, 0] + 0.5) * rate) * fine) / (rate * fine)
    force = np.zeros(len(t))
    for begin, speed, launch, lasts in rows:
        x = np.clip((t - begin) / lasts, 0.0, 1.0)
        force += mass * (speed + launch) / lasts * 0.5 * np.pi * np.sin(np.pi * x)
    return np.asarray(force.reshape(-1, fine).mean(axis=1))


def rings(rows: np.ndarray, rate: float, decay: float = 3e-3) -> np.ndarray:
    """Rings that impacts leave in a table or a piezo: as loud as the impacts are fast; at most 1."""
    t = np.arange(round((rows[-1, 0] + 0.5) * rate)) / rate
    y = np.zeros(len(t))
    for begin, speed, _, _ in rows:
        after = np.maximum(t - begin, 0.0)
        y += speed * np.sin(2 * np.pi * min(3100.0, 0.31 * rate) * after) * np.exp(-after / decay)
    return np.asarray(y / np.abs(y).max())


def noisy(values: np.ndarray, sd: float, seed: int = 1) -> np.ndarray:
    return np.asarray(values + sd * np.random.default_rng(seed).standard_normal(len(values)))


def lines(values: np.ndarray, rate: float, form: str = "{0:.6f},{1:.5f}\n") -> str:
    return "".join(form.format(i / rate, y) for i, y in enumerate(values))


@pytest.mark.parametrize(("rate", "side"), [(1000.0, 1.0), (1000.0, -1.0), (4000.0, 1.0)])
def test_a_force_plate_gives_alpha_without_a_mass_and_weighs_the_ball(
    tmp_path: Path, rate: float, side: float
) -> None:
    """8 samples a push at 1 kHz, with an offset, a drift and the hum of the mains."""
    force = noisy(side * pushes(impacts(2, 8, 8e-3), rate, 0.15), 0.4)
    t = np.arange(len(force)) / rate
    force += 7.0 + 2.0 * t + 0.3 * np.sin(2 * np.pi * 50 * t)
    path = write(tmp_path, "time [s],force [N]\n" + lines(force, rate))
    found = hb.fit(path)
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high
    (said,) = found.warnings
    assert "the pushes are those of a ball of 0.1" in said
    with pytest.raises(UserError, match=r"pushes of a ball of 0\.1"):
        hb.fit(path, mass="0.3 kg")


def test_four_pushes_are_one_ball_s_by_their_impulses(tmp_path: Path) -> None:
    """Four clicks may be anything; four pushes of one mass are a ball's."""
    force = noisy(pushes(impacts(3, 4, 8e-3), 1000, 0.2), 0.2)
    found = hb.fit(write(tmp_path, "time [s],force [N]\n" + lines(force, 1000)))
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high
    assert not found.doubts


def test_a_sample_dropped_in_a_push_leaves_its_impulse(tmp_path: Path) -> None:
    """In the middle of a recording its times are wrong by half a step, as rounded ones may be."""
    rate = 1000.0
    times = np.arange(400) / rate
    force = 100.0 * np.cos(np.clip((times - 0.2) / 0.011, -0.5, 0.5) * np.pi)
    impulse = force.sum() / rate
    kept = np.delete(np.stack([times, force], axis=1), 201, axis=0)
    rows = "".join(f"{t:.3f},{f:.4f}\n" for t, f in kept)
    signal = signal_in(Path(write(tmp_path, "time [s],force [N]\n" + rows)))
    assert signal is not None
    assert signal.values.sum() / signal.rate == pytest.approx(impulse, rel=0.02)


@pytest.mark.parametrize("rate", [120.0, 240.0, 400.0, 480.0, 800.0, 1000.0])
def test_times_in_whole_milliseconds_are_evened(rate: float) -> None:
    times = np.arange(500) / rate
    even = evened(np.round(times, 3))
    assert even is not None
    assert even == pytest.approx(times, abs=1e-3)


SCOPES = {
    "Rigol": "X,CH1,Start,Increment,\nSequence,Volt,0.000000e+00,4.000000e-05\n",
    "Siglent": "Record Length,Analog:9\nSample Interval,0.00004\nModel Number,SDS1104X-E\nSecond,Volt\n",
    "Keysight": "x-axis,1\nsecond,Volt\n",
    "PicoScope": "Time,Channel A\n(ms),(mV)\n\n",
    "Saleae": "Time [s],Channel 0\n",
    "no header": "",
    "Audacity": "Sample Rate: 25000 Hz. Sample values on linear scale. 1 channel (mono).\n\n",
}
FORMS = {"Rigol": "{2},{1:.4e},\n", "PicoScope": "{3:.4f},{1:.4f}\n", "Audacity": "{1:.6f}\n"}


@pytest.mark.parametrize("program", SCOPES)
def test_programs_write_one_signal(tmp_path: Path, program: str) -> None:
    rate = 25_000.0
    values = noisy(rings(impacts(1, 5, 1e-4), rate), 0.01)
    form = FORMS.get(program, "{0:.8f},{1:.5f}\n")
    rows = (form.format(i / rate, y, i, 1e3 * i / rate) for i, y in enumerate(values))
    signal = signal_in(Path(write(tmp_path, SCOPES[program] + "".join(rows))))
    assert signal is not None
    assert signal.rate == pytest.approx(rate, rel=1e-6)
    np.testing.assert_allclose(signal.values, values, atol=1e-4)


def test_tektronix_writes_its_settings_beside_the_first_samples(tmp_path: Path) -> None:
    values = noisy(rings(impacts(1, 8, 1e-4), 5000), 0.01)
    settings = ["Record Length,9,Points", "Sample Interval,2.0e-04,s", "Vertical Units,V,"]
    texts = lines(values, 5000, ",{0:.6f},{1:.5f},\n").splitlines()
    rows = [f"{settings[i] if i < 3 else ',,'},{text}" for i, text in enumerate(texts)]
    found = hb.fit(write(tmp_path, "\n".join(rows)))
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high


@pytest.mark.parametrize(
    ("header", "rate", "form"),
    [
        ("", 1000.0, "{4},{5:.0f}\n"),
        ("t_us,adc\n", 5000.0, "{3:.0f},{5:.0f}\n"),
        ("time [s]\tbridge [mV]\n", 10_000.0, "{0:.5f}\t{1:.5f}\n"),
        ("Zeit [ms];Signal [V]\n", 2000.0, "{2};{1:.3f}\n"),
    ],
)
def test_a_load_cell_needs_no_scale(tmp_path: Path, header: str, rate: float, form: str) -> None:
    """Volts or counts of a converter: times alone give α."""
    y = pushes(impacts(4, 8, 6e-3), rate)
    y = noisy(y / y.max(), 5e-3)
    rows = []
    for i, one in enumerate(y):
        t = i / rate
        comma = f"{1e3 * t:.1f}".replace(".", ",")
        text = form.format(t, one, comma, 1e6 * t + 5e6, round(1e3 * t) + 4213, 90 + 800 * one)
        rows.append(text.replace(".", ",") if ";" in form else text)
    found = hb.fit(write(tmp_path, header + "".join(rows)))
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high


def test_an_accelerometer_in_the_ball_is_clipped_and_weightless_in_flight(tmp_path: Path) -> None:
    rows = impacts(5, 7, 0.012, drop=0.9)
    a = pushes(rows, 400)
    t = np.arange(len(a)) / 400
    held = (t < rows[0, 0] - 0.43) | (t > rows[-1, 0] + 0.1)
    a = np.clip(noisy(a + held * G.value, 0.15), -16 * G.value, 16 * G.value) / G.value
    found = hb.fit(write(tmp_path, "time_s,a_g\n" + lines(a, 400)))
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high


@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_a_phone_on_the_table_feels_the_ball(tmp_path: Path, rate: float) -> None:
    t = np.arange(round(16 * rate * 4)) / (16 * rate)
    z = np.zeros(len(t))
    for begin, speed, _, _ in impacts(6, 8, 2e-4, drop=0.8):
        after = np.maximum(t - begin, 0.0)
        z += 5 * speed * np.sin(2 * np.pi * 0.3 * rate * after) * np.exp(-after / 0.01)
    z = noisy(z.reshape(-1, 16).mean(axis=1), 0.05)
    names = ",".join(f'"Linear Acceleration {axis} (m/s^2)"' for axis in "xyz")
    rows = zip(noisy(0 * z, 0.02, 2), noisy(0 * z, 0.02, 3), z, strict=True)
    table = "".join(f"{i / rate:.6E},{a:.6E},{b:.6E},{c:.6E}\n" for i, (a, b, c) in enumerate(rows))
    found = hb.fit(write(tmp_path, f'"Time (s)",{names}\n{table}'))
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high


def test_phyphox_packs_its_tables(tmp_path: Path) -> None:
    y = noisy(rings(impacts(1, 8, 1e-4), 1000), 0.01)
    with zipfile.ZipFile(tmp_path / "Acceleration.zip", "w") as archive:
        archive.writestr("Raw Data.csv", '"Time (s)","Acceleration z (m/s^2)"\n' + lines(y, 1000))
        archive.writestr("meta/device.csv", "property,value\nversion,1\n")
    found = hb.fit(tmp_path / "Acceleration.zip")
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high


def two_balls() -> np.ndarray:
    one, other = impacts(1, 6, 8e-3, drop=0.7), impacts(2, 6, 1e-2, drop=0.45)
    other[:, 0] += 0.23
    return np.array(sorted([*one.tolist(), *other.tolist()]))


def regular(every: float, lasts: float) -> np.ndarray:
    return np.array([(0.4 + every * i, 3.0, 2.8, lasts) for i in range(9)])


def uneven(seed: int, lasts: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    times = 0.4 + np.cumsum(rng.uniform(0.35, 0.65, 8))
    return np.array([(t, v, 0.0, lasts) for t, v in zip(times, rng.uniform(1, 2, 8), strict=True)])


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (regular(0.55, 0.015), "A clock keeps its intervals"),
        (regular(0.62, 0.25), "expected those of a ball, up to 0.05 s"),
    ],
    ids=["dribbling", "hopping"],
)
def test_pushes_of_no_single_ball_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], rows: np.ndarray, said: str
) -> None:
    force = noisy(pushes(rows, 1000, 0.5), 0.3)
    path = write(tmp_path, "time [s],force [N]\n" + lines(force, 1000))
    assert run(["fit", path]) == 2
    assert said in capsys.readouterr().err


def test_two_balls_on_one_plate_give_no_number(tmp_path: Path) -> None:
    force = noisy(pushes(two_balls(), 1000, 0.5), 0.3)
    path = write(tmp_path, "time [s],force [N]\n" + lines(force, 1000))
    try:
        found = hb.fit(path)
    except UserError:
        return
    assert found.law is None and found.alpha is None and found.restitution is None


@pytest.mark.parametrize("seed", range(6))
def test_a_hammer_and_hands_give_no_number(tmp_path: Path, seed: int) -> None:
    y = noisy(rings(uneven(seed, 1e-3), 5000), 0.02)
    try:
        found = hb.fit(write(tmp_path, "Time(s),CH1(V)\n" + lines(y, 5000)))
    except UserError:
        return
    assert found.law is None and found.alpha is None and found.restitution is None


def test_a_signal_without_touches_says_what_is_in_it(tmp_path: Path) -> None:
    quiet = write(tmp_path, "time [s],bridge [mV]\n" + lines(noisy(np.zeros(3000), 0.02), 1000))
    with pytest.raises(UserError, match=r"no pulses in 'bridge \[mV\]'"):
        hb.fit(quiet)
    two = pushes(impacts(1, 2, 8e-3), 1000)
    with pytest.raises(UserError, match=r"pulses in 'bridge \[mV\]' at 0\.40\d, 0\.\d+ s"):
        hb.fit(write(tmp_path, "time [s],bridge [mV]\n" + lines(noisy(two, 0.2), 1000)))


def test_a_push_of_eight_samples_has_e_and_no_stiffness(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = impacts(7, 1, 8e-3)
    speed, launch = rows[0, 1:3]
    force = noisy(pushes(rows, 1000, 0.45), 1.0)
    path = write(tmp_path, "time [s],force [N]\n" + lines(force, 1000))
    found = hb.fit_force(path, mass="0.45 kg", speed=f"{speed} m/s")
    assert abs(found.e - launch / speed) < 2.0 * found.e_uncertainty < 0.05
    assert found.alpha_interval[0] < ALPHA < found.alpha_interval[1]
    assert not found.is_law
    assert run(["fit", path, "--mass", "0.45 kg", "--speed", f"{speed} m/s"]) == 0
    assert "need 20 samples or more" in capsys.readouterr().out


def test_times_of_samples_that_are_rounded_keep_the_impulse(tmp_path: Path) -> None:
    """At 4800 Hz and 0.1 ms, steps of 0.2 and 0.3 ms take turns."""
    rows = impacts(8, 1, 3e-3)
    speed, launch = rows[0, 1:3]
    force = noisy(pushes(rows, 4800, 0.145), 1.0)
    path = write(tmp_path, "time [s],force [N]\n" + lines(force, 4800, "{0:.4f},{1:.3f}\n"))
    found = hb.fit_force(path, mass="0.145 kg", speed=f"{speed} m/s")
    assert abs(found.e - launch / speed) < 2.0 * found.e_uncertainty < 0.05


def test_a_marker_on_the_wall_is_no_ball(tmp_path: Path) -> None:
    times, heights = synthesise.track(
        synthesise.hunt_crossley(ALPHA), 0.8, 4e-3, 1e-3, 120, np.random.default_rng(1)
    )
    rows = "".join(f"{t:.4f},{y:.4f},0.2501\n" for t, y in zip(times, heights, strict=True))
    found = hb.fit(write(tmp_path, f"t [s],ball y [m],marker y [m]\n{rows}"))
    assert found.alpha is not None and found.alpha.low <= ALPHA <= found.alpha.high
