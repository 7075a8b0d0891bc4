"""α from measured bounces: unbiased, with intervals that hold, and the law told or left open."""

from __future__ import annotations

import json
import math
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.io import wavfile

from hcbench.cli import run
from hcbench.cli.tune import parse_points
from hcbench.errors import UserError
from hcbench.fitting import fit_files
from hcbench.fitting.candidates import LAWS, dissipation_of, hunt_crossley
from hcbench.fitting.datasets import Heights, TouchTimes
from hcbench.fitting.estimate import fit_law
from hcbench.fitting.flight import Ballistics, in_air
from hcbench.fitting.pairs import SpeedPairs
from hcbench.fitting.result import fit
from hcbench.fitting.setup import Known, MeasurementSetup
from hcbench.fitting.sound import Recording, find_touches
from hcbench.fitting.track import Track, track_of
from hcbench.laws import closed_form
from hcbench.units import parse_uncertain

sys.path.insert(0, str(Path(__file__).parents[2] / "examples" / "recording"))
import synthesise

G = Known(9.80665)
EXACT = MeasurementSetup(gravity=G)
TRIALS = 40


def times_of(law: synthesise.Law, seed: int, **more: float) -> np.ndarray:
    what: Any = {"drop": 0.3, "timing": 2e-4, "scatter": 5e-3, "most": 15, **more}
    return np.asarray(synthesise.touch_times(law, rng=np.random.default_rng(seed), **what))


# --- the law and the flight ---


@pytest.mark.parametrize("d", [1e-7, 1e-3, 0.1, 1.0, 10.0, 41.0, 100.0])
def test_the_scalar_law_is_the_closed_form_and_its_slope(d: float) -> None:
    log_e, slope = hunt_crossley(d)
    assert math.exp(log_e) == pytest.approx(float(closed_form.restitution(d / 1.5, 1.0)), rel=1e-12)
    up, down = (hunt_crossley(d * f)[0] for f in (1 + 1e-4, 1 - 1e-4))
    assert slope == pytest.approx((up - down) / 2e-4, rel=1e-4)
    assert dissipation_of(log_e) == pytest.approx(d, rel=1e-9)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("speed", [0.1, 0.5, 2.0])
def test_laws_know_their_own_derivatives(name: str, speed: float) -> None:
    law = LAWS[name]
    parameters = [-0.2, -0.05][: law.count]
    local = law.curve(tuple(parameters), 0.5).local(speed)
    for i, by in enumerate(local[2]):
        moved = [
            law.curve(tuple(p + s * 1e-6 * (i == j) for j, p in enumerate(parameters)), 0.5).local(speed)[0]
            for s in (1, -1)
        ]
        assert by == pytest.approx((moved[0] - moved[1]) / 2e-6, abs=1e-6)
    ends = [law.curve(tuple(parameters), 0.5).local(speed * f)[0] for f in (1 + 1e-6, 1 - 1e-6)]
    assert local[1] == pytest.approx((ends[0] - ends[1]) / 2e-6, abs=1e-6)


@pytest.mark.parametrize("launch", [0.3, 2.0, 4.0])
def test_a_flight_in_air_is_that_of_the_equation_of_motion(launch: float) -> None:
    ball = in_air(9.80665, 2.7e-3, 0.04, 0.47)
    aloft, touch = synthesise.flight_in_air(launch, 2.7e-3, 0.04, 0.47)
    assert ball.aloft(launch)[0] == pytest.approx(aloft, rel=1e-7)
    assert ball.touch(launch)[0] == pytest.approx(touch, rel=1e-7)


@pytest.mark.parametrize("ball", [Ballistics(9.81), Ballistics(9.81, 0.1)])
def test_flights_know_their_own_derivatives(ball: Ballistics) -> None:
    t = np.array([0.05, 0.2, 0.35])
    for name in ("aloft", "touch", "apex", "dropped"):
        of = getattr(ball, name)
        assert of(1.7)[1] == pytest.approx((of(1.7 + 1e-6)[0] - of(1.7 - 1e-6)[0]) / 2e-6, rel=1e-7)
    for of in (ball.path, ball.fall):
        _, by, velocity = of(2.0, t * (1 if of == ball.path else 0.3))
        ends = [of(2.0 + s, t * (1 if of == ball.path else 0.3))[0] for s in (1e-6, -1e-6)]
        assert by == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-6)
        sign, at = (1, t) if of == ball.path else (-1, 0.3 * t)
        later, earlier = (of(2.0, at + sign * s)[0] for s in (1e-6, -1e-6))
        assert velocity == pytest.approx((later - earlier) / 2e-6, rel=1e-5)
    assert ball.path(1.7, np.array([ball.aloft(1.7)[0]]))[0] == pytest.approx(0.0, abs=1e-12)


# --- α ---


def trials(make: Any, truth: float, count: int = TRIALS) -> tuple[float, float]:
    """(rms error of α, share of 95 % intervals that hold it)."""
    off, held = [], 0
    for seed in range(count):
        data = make(seed)
        found = fit_law(LAWS["hunt-crossley"], [data], float(np.exp(np.log(data.pairs()[0]).mean())))
        values = np.array(
            [
                LAWS["hunt-crossley"].describe(tuple(p), found.reference)["alpha"]
                for p in found.posterior.parameters
            ]
        )
        low, middle, high = found.posterior.quantiles(values, (0.025, 0.5, 0.975))
        off.append(middle / truth - 1)
        held += low <= truth <= high
    return float(np.sqrt(np.mean(np.square(off)))), held / count


@pytest.mark.parametrize(("alpha", "rms"), [(0.05, 0.03), (0.2, 0.018), (1.0, 0.014)])
def test_times_give_alpha_and_an_interval_that_holds(alpha: float, rms: float) -> None:
    law = synthesise.hunt_crossley(alpha)
    error, held = trials(lambda seed: TouchTimes("t", EXACT, times_of(law, seed)), alpha)
    assert error < rms
    assert held >= 0.87


def test_timing_alone_leaves_next_to_no_error() -> None:
    law = synthesise.hunt_crossley(0.2)
    make = lambda seed: TouchTimes("t", EXACT, times_of(law, seed, timing=5e-5, scatter=0.0))  # noqa: E731
    error, held = trials(make, 0.2, 15)
    assert error < 5e-4
    assert held == 1.0


@pytest.mark.parametrize(("alpha", "rms"), [(0.05, 0.006), (0.3, 0.01), (1.0, 0.03)])
def test_heights_give_alpha(alpha: float, rms: float) -> None:
    law, setup = synthesise.hunt_crossley(alpha), MeasurementSetup(gravity=G, height=Known(0.3, 1e-6))

    def make(seed: int) -> Heights:
        rng = np.random.default_rng(seed)
        return Heights("h", setup, synthesise.bounce_heights(law, 0.3, 1e-3, 0.0, rng))

    error, held = trials(make, alpha)
    assert error < 1.3 * rms
    assert held >= 0.87


@pytest.mark.parametrize("alpha", [0.05, 0.5])
@pytest.mark.parametrize("twice", [False, True])
def test_pairs_give_alpha(alpha: float, twice: bool) -> None:
    law = synthesise.hunt_crossley(alpha)

    def make(seed: int) -> SpeedPairs:
        rng = np.random.default_rng(seed)
        v = rng.uniform(0.1, 2.0, 20)
        e = np.array([law(s) for s in v]) * (1 + 0.005 * rng.standard_normal(20))
        read = v * (1 + 0.01 * rng.standard_normal(20))
        if twice:  # v_out has an error of its own
            e = e * v * (1 + 0.01 * rng.standard_normal(20)) / read
            return SpeedPairs("p", EXACT, read, e, 0.01 * read, 0.01 * e, twice=True)
        return SpeedPairs("p", EXACT, read, e, 0.01 * read, np.zeros(20))

    assert trials(make, alpha)[1] >= 0.87


def test_one_drop_height_more_narrows_the_interval() -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 1)
    without = fit([TouchTimes("t", EXACT, times)], "hunt-crossley")
    given = fit(
        [TouchTimes("t", MeasurementSetup(gravity=G, height=Known(0.3, 1e-3)), times)], "hunt-crossley"
    )
    assert without.alpha is not None and given.alpha is not None
    assert given.alpha.uncertainty < without.alpha.uncertainty


def test_several_files_share_one_alpha() -> None:
    law = synthesise.hunt_crossley(0.3)
    files = [TouchTimes(f"{i}", EXACT, times_of(law, i)) for i in range(4)]
    four, *each = (fit(sets, "hunt-crossley").alpha for sets in [files, *([file] for file in files)])
    assert four is not None
    assert four.uncertainty < 0.6 * float(np.mean([one.uncertainty for one in each if one is not None]))
    assert four.low < 0.3 < four.high


def test_alpha_goes_as_one_over_g_and_the_budget_says_so() -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 1)
    at = [
        fit([TouchTimes("t", MeasurementSetup(gravity=Known(g, 0.05)), times)], "hunt-crossley")
        for g in (9.80665, 9.9)
    ]
    assert at[0].alpha is not None and at[1].alpha is not None
    assert at[0].alpha.value / at[1].alpha.value == pytest.approx(9.9 / 9.80665, rel=1e-6)
    (row,) = (row for row in at[0].budget.rows if row.source == "gravity")
    assert row.share == pytest.approx(at[0].alpha.value * 0.05 / 9.80665, rel=0.02)


def test_drag_that_is_left_out_makes_a_table_tennis_ball_lossy() -> None:
    ball: Any = {"mass": Known(2.7e-3), "diameter": Known(0.04), "drag_coefficient": Known(0.47)}
    fly = lambda w: synthesise.flight_in_air(w, 2.7e-3, 0.04, 0.47)  # noqa: E731
    rng, times = np.random.default_rng(0), [0.0]
    speed = MeasurementSetup(gravity=G, **ball).ballistics.dropped(0.3)[0]
    for _, _, aloft in synthesise.flights(synthesise.hunt_crossley(0.1), 0.3, 0.0, rng, fly, speed):
        times.append(times[-1] + aloft)
        if len(times) == 15:
            break
    in_a_vacuum = fit([TouchTimes("t", EXACT, np.array(times))], "hunt-crossley").alpha
    in_air = fit(
        [TouchTimes("t", MeasurementSetup(gravity=G, **ball), np.array(times))], "hunt-crossley"
    ).alpha
    assert in_a_vacuum is not None and in_air is not None
    assert in_air.value == pytest.approx(0.1, rel=1e-4)
    assert in_a_vacuum.value == pytest.approx(0.1055, rel=0.01)


def test_a_fit_shows_itself_in_a_notebook(tmp_path: Path) -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 1)
    path = write(tmp_path, "time [s]\n" + "\n".join(f"{t:.6f}" for t in times), "<b>.csv")
    found = fit_files(path, setup=EXACT)
    assert found.alpha is not None
    shown = found._repr_html_()
    assert f"{found.alpha.value:.3f}" in shown and "&lt;b&gt;.csv" in shown and "<b>" not in shown
    (axes,) = found.plot().axes
    law, data = (np.asarray(line.get_xydata()) for line in axes.lines)
    assert len(data) == len(times) - 2
    assert np.interp(1.0, *law.T) == pytest.approx(synthesise.hunt_crossley(0.3)(1.0), abs=0.01)


# --- which law ---


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (synthesise.hunt_crossley(0.3), "hunt-crossley"),
        (synthesise.constant(0.7), "constant"),
        (synthesise.viscoelastic(0.25), "viscoelastic"),
        (synthesise.plastic(0.8), "plastic"),
        (synthesise.hunt_crossley(0.3, e0=0.9), "hunt-crossley with e0"),
    ],
)
def test_the_law_is_told_from_good_data(law: synthesise.Law, name: str) -> None:
    for seed in range(3):
        found = fit([TouchTimes("t", EXACT, times_of(law, seed, timing=5e-5, scatter=2e-3, most=20))])
        assert found.law == name


def test_few_poor_touches_do_not_tell_the_law() -> None:
    left_open, widths = 0, []
    for seed in range(6):
        times = times_of(synthesise.hunt_crossley(0.3), seed, timing=1e-3, scatter=1e-2, most=6)
        found = fit([TouchTimes("t", EXACT, times)])
        left_open += found.law is None
        assert found.law in (None, "hunt-crossley")
        assert found.alpha is not None
        widths.append(found.alpha.uncertainty)
    assert np.median(widths) > 0.005
    assert left_open >= 4


def test_a_mistimed_touch_is_flagged_and_kept() -> None:
    times = times_of(synthesise.hunt_crossley(0.2), 2)
    assert not fit([TouchTimes("t", EXACT, times)], "hunt-crossley").flags
    times[5] += 4e-3
    (flag,) = fit([TouchTimes("t", EXACT, times)], "hunt-crossley").flags
    assert flag.touch.startswith("touch 6 ") and flag.what == "measured off"
    assert flag.size == pytest.approx(4e-3, rel=0.3)


def test_bounces_that_gain_energy_are_refused() -> None:
    with pytest.raises(UserError, match="gain energy"):
        fit([TouchTimes("t", EXACT, np.array([0.0, 0.1, 0.21, 0.33, 0.46, 0.6, 0.75]))])


# --- files and the command ---


def write(folder: Path, text: str, name: str = "data.csv") -> str:
    (folder / name).write_text(text, encoding="utf-8")
    return str(folder / name)


def test_the_command_hands_alpha_to_tune_and_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = times_of(synthesise.hunt_crossley(0.3), 4)
    path = write(tmp_path, "time [ms]\n" + "\n".join(f"{1e3 * t:.3f}" for t in times))
    points = tmp_path / "points.csv"
    assert run(["fit", path, "--gravity", "9.80665", "--json", "--write-points", str(points)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["law"] == "hunt-crossley"
    low, high = found["alpha_interval_95_s_per_m"]
    assert low < 0.3 < high
    assert low < found["alpha_s_per_m"] < high
    assert {law["law"] for law in found["laws"]} == set(LAWS)
    assert run(["fit", path]) == 0
    shown = capsys.readouterr().out
    assert 'hcbench tune mujoco --alpha "0.29' in shown and " +- 0.00" in shown
    assert len(parse_points(str(points))) == 20


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time\n0.1\n0.2\n", "names no unit"),
        ("0.1\n0.2\n0.3\n", "a header"),
        ("time [s]\n0.1\nx\n", "line 3: 'x' under 'time'"),
        ("time [s]\n0.1\nnan\n", "line 3: 'nan'"),
        ("time [s]\n0.3\n0.2\n0.4\n0.5\n", "line 3: time 0.2; expected times that rise"),
        ("time [s]\n0.1\n0.4\n0.6\n", "3 touches"),
        ("time [kg]\n0.1\n0.4\n0.6\n", "'kg'"),
        ("weather\n1\n", "'weather'"),
        ("speed [m/s],restitution\n1,0\n2,0\n3,0\n", "a rest only"),
        ("", "is empty"),
        ("time [s]\n", "no rows"),
    ],
)
def test_a_bad_file_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    assert run(["fit", write(tmp_path, text)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line


def test_g_that_is_not_known_is_refused_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, "time [s]\n0.1\n0.4\n0.6\n0.7\n")
    assert run(["fit", path, "--gravity", "unknown"]) == 2
    assert "α g only" in capsys.readouterr().err


# --- tracks and other programs' exports ---


@pytest.mark.parametrize(("alpha", "frames"), [(0.1, 60), (0.4, 240), (1.0, 60)])
def test_a_track_gives_alpha(alpha: float, frames: float) -> None:
    law = synthesise.hunt_crossley(alpha)

    def make(seed: int) -> Track:
        rng = np.random.default_rng(seed)
        return track_of("film", EXACT, *synthesise.track(law, 0.5, 4e-3, 1e-3, frames, rng))

    error, held = trials(make, alpha, 20)
    assert error < 0.017
    assert held >= 0.8


def test_a_wrong_scale_of_a_film_is_told() -> None:
    times, heights = synthesise.track(
        synthesise.hunt_crossley(0.2), 0.5, 4e-3, 1e-3, 120, np.random.default_rng(1)
    )
    assert not fit([track_of("film", EXACT, times, heights)]).warnings
    (warning,) = fit([track_of("film", EXACT, times, 1.05 * heights)]).warnings
    assert "105." in warning and "scale" in warning


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
    assert run(["fit", write(tmp_path, "#multi:\n" + text, "two.txt")]) == 2
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


# --- sound ---


@pytest.mark.parametrize("surface", synthesise.SURFACES)
def test_touches_are_heard(surface: str) -> None:
    rng = np.random.default_rng(1)
    for decibels in (50, 40, 30):
        sound, at = synthesise.drop_recording(
            synthesise.hunt_crossley(0.3), 0.4, 3e-3, surface, decibels, rng, seconds=4.0
        )
        picks = find_touches(Recording("r", sound, 44100))
        heard = at[picks.numbers]
        assert len(heard) >= len(at) - 10
        off = picks.times - heard
        assert np.abs(off - np.median(off)).max() < 3e-3
        assert np.median(np.abs(off - np.median(off))) < 2e-5


def wav(path: Path, kind: str, sound: np.ndarray, rate: int = 44100) -> Path:
    """A recording in one of the formats that phones and programs write."""
    if kind == "24":
        whole = np.round(sound * (2**23 - 1)).astype("<i4")
        data = whole.view(np.uint8).reshape(-1, 4)[:, :3].tobytes()
        head = b"RIFF" + (36 + len(data)).to_bytes(4, "little") + b"WAVEfmt " + (16).to_bytes(4, "little")
        head += b"\1\0\1\0" + rate.to_bytes(4, "little") + (3 * rate).to_bytes(4, "little") + b"\3\0\x18\0"
        path.write_bytes(head + b"data" + len(data).to_bytes(4, "little") + data)
        return path
    both = np.stack([0.01 * sound, sound], axis=1)
    samples: dict[str, Any] = {
        "8": np.round(127 * sound + 128).astype(np.uint8),
        "16": np.round(32767 * sound).astype(np.int16),
        "float": sound.astype(np.float32),
        "stereo": np.round(32767 * both).astype(np.int16),
    }
    wavfile.write(path, rate, samples[kind])
    return path


@pytest.mark.parametrize("kind", ["8", "16", "24", "float", "stereo"])
def test_all_kinds_of_wav_are_read(tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str) -> None:
    sound, _ = synthesise.drop_recording(
        synthesise.hunt_crossley(0.5), 0.3, 3e-3, "stone", 45, np.random.default_rng(2), 0.05
    )
    path = str(wav(tmp_path / "drop.wav", kind, sound))
    assert run(["fit", path, "--json", "--touches", "1:6"]) == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found["alpha_interval_95_s_per_m"]
    assert low < 0.5 < high
    assert found["files"][0]["impacts"] == 4


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("drop.m4a", b"\0\0\0 ftypM4A \xff\xfe", "ffmpeg -i drop.m4a drop.wav"),
        ("drop.wav", b"RIFF\0\0\0\0WAVEjunk", "cannot be read as WAV"),
        ("data.zip", b"PK\3\4\xff\xfe", "Unpack"),
        ("data.bin", b"\xff\xfe\0\1", "neither UTF-8 text nor a WAV"),
    ],
)
def test_what_is_no_sound_is_one_line_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes, says: str
) -> None:
    (tmp_path / name).write_bytes(content)
    assert run(["fit", str(tmp_path / name)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line


def test_noise_has_no_train_of_bounces() -> None:
    noise = synthesise.pink_noise(100_000, np.random.default_rng(0)) * 0.1
    with pytest.raises(UserError, match=r"train of bounces|touches"):
        picks = find_touches(Recording("n", noise, 44100))
        assert len(picks.times) > 3, "touches"


# --- forces ---

K, N, ALPHA, MASS = 3e7, 1.5, 0.3, 0.45


def pushed(speed: float, alpha: float = ALPHA) -> tuple[np.ndarray, ...]:
    """(time, penetration, rate, force) of one impact of eq. (16), by an ODE."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -K * max(y[0], 0.0) ** N * (1 + 1.5 * alpha * y[1]) / MASS]

    done = solve_ivp(rate, (0, 4e-3), [0.0, speed], rtol=1e-10, atol=1e-13, max_step=1e-5, dense_output=True)
    t = np.arange(0.0, 4e-3, 1e-5)
    x, v = np.asarray(done.sol(t))  # type: ignore[misc]
    f = K * np.maximum(x, 0.0) ** N * (1 + 1.5 * alpha * v)
    return t, x, v, np.where(x > 0, f, 0.0)


def test_force_over_time_gives_stiffness_exponent_and_alpha(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    *_, f = pushed(0.8)
    rng, off = np.random.default_rng(1), []
    for _ in range(5):
        noisy = 12.0 + np.concatenate([np.zeros(300), f]) + 4e-3 * f.max() * rng.standard_normal(300 + len(f))
        at = 1e3 * np.arange(len(noisy)) * 1e-5
        rows = "\n".join(f"{a:.5f},{b:.4f}" for a, b in zip(at, noisy, strict=True))
        path = write(tmp_path, f"time [ms],force [N]\n{rows}\n")
        assert run(["fit", path, "--mass", "0.45 kg", "--speed", "0.8 m/s", "--json"]) == 0
        found = json.loads(capsys.readouterr().out)
        off.append(
            [
                found["alpha_s_per_m"] / ALPHA - 1,
                found["exponent"] - N,
                math.log(found["stiffness_n_per_m_n"] / K),
            ]
        )
        assert found["law"] == "hunt-crossley"
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < [0.02, 0.03, 0.3]).all()
    assert run(["fit", path]) == 2
    assert "mass" in capsys.readouterr().err
    assert run(["fit", path, "--mass", "0.45 kg", "--speed", "0.3 m/s"]) == 2
    assert "impulse" in capsys.readouterr().err


def test_force_over_penetration_gives_stiffness_exponent_and_alpha(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng, rows = np.random.default_rng(1), []
    for speed in (0.4, 0.8, 1.2):
        _, x, v, f = (column[::3] for column in pushed(speed))
        rows += [
            f"{1e6 * (a + 2e-6 * rng.standard_normal()):.4f},{b:.6f},{c + rng.standard_normal():.4f}"
            for a, b, c in zip(x, v, f, strict=True)
            if a > 0
        ]
    path = write(tmp_path, "penetration [um],rate [m/s],force [N]\n" + "\n".join(rows))
    assert run(["fit", path, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["alpha_s_per_m"] == pytest.approx(ALPHA, rel=0.03)
    assert found["exponent"] == pytest.approx(N, abs=0.03)
    low, high = found["alpha_interval_95_s_per_m"]
    assert low < ALPHA < high
    assert run(["fit", path, "--exponent", "1.5"]) == 0
    assert "hcbench tune" in capsys.readouterr().out


# --- the worked example, its page, and what comes after ---


def test_the_recording_of_the_example_goes_all_the_way_to_a_tuned_scene(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    example = Path(synthesise.__file__).with_name("drop.wav")
    monkeypatch.setattr(sys, "argv", ["synthesise.py", str(tmp_path / "again.wav")])
    synthesise.main()
    assert np.abs(wavfile.read(tmp_path / "again.wav")[1] - wavfile.read(example)[1].astype(int)).max() <= 1
    page, scene = tmp_path / "drop.html", tmp_path / "tuned.xml"
    assert run(["fit", str(example), "--gravity", "9.80665 m/s^2", "--page", str(page), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    low, high = found["alpha_interval_95_s_per_m"]
    assert found["law"] == "hunt-crossley" and low < 0.3 < high
    text = page.read_text(encoding="utf-8")
    assert text.count("data:image/svg+xml") == 3 and "<script" not in text
    alpha = f"{found['alpha_s_per_m']:.4f} +- {found['alpha_standard_uncertainty_s_per_m']:.4f} s/m"
    said = ["--alpha", alpha, "--timestep", "1e-3", "--speeds", "0.2:1.4 m/s"]
    assert run(["tune", "mujoco", *said, "--write-scene", str(scene)]) == 0
    assert "e is known to ± 0.00" in capsys.readouterr().out
    gate = ["--pair", "ball,plate", "--alpha", alpha, "--speeds", "0.3, 1 m/s"]
    assert run(["check", str(scene), *gate]) == 0
    assert "by which e is known to ± 0.00" in capsys.readouterr().out


@pytest.mark.parametrize(
    "text",
    [
        "0.31 +- 0.004 s/m",
        "0.31 s/m +- 0.004 s/m",
        "(0.31 ± 0.004) s/m",
        "0.31 +/- 0.004 s/m",
        "31e-2 ± 4e-3",
    ],
)
def test_a_quantity_may_have_an_uncertainty(text: str) -> None:
    assert parse_uncertain(text, "alpha") == pytest.approx((0.31, 0.004))


@pytest.mark.parametrize("text", ["0.31 +- x s/m", "0.31 +- -1 s/m", "+- 0.1 s/m", "0.3 kg +- 0.1 s/m"])
def test_a_wrong_uncertainty_is_refused(text: str) -> None:
    with pytest.raises(UserError):
        parse_uncertain(text, "alpha")


# --- what nobody measures ---

TIMES = "time [s]\n0\n0.286\n0.488\n0.643\n0.77\n"
FALLS = "height [cm]\n" + "".join(f"{30 * 0.7**i:.6g}e{{power}}\n" for i in range(9))
LOOP = "penetration [um],rate [m/s],force [N]\n" + "".join(
    f"{10 * math.sin(0.05 * i):.6g},{0.5 * math.cos(0.05 * i):.6g},{{force}}\n" for i in range(1, 60)
)
PAIRS = "speed [m/s],restitution\n" + "".join(f"{0.1 + 1e-3 * i:.4f},0.9\n" for i in range(501))


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (TIMES, ("--gravity", "1e29"), "--gravity: 1e\\+29; expected above 0: 1e-09 ... 1e\\+09 in SI"),
        (TIMES, ("--contact-time", "3"), "--contact-time: 3 s, and two touches 0.127 s apart"),
        (TIMES, ("--touches", "²:³"), "--touches: '²:³'; expected the first and the last"),
        (FALLS.format(power=149), (), "line 2: 30e149 under 'height'; expected 0, or 1e-12"),
        (TIMES.replace("\n0.", "\n0.0000000000000"), (), "line 3: .* under 'time'; expected 0, or 1e-12"),
        (LOOP.format(force=0), (), "numbers that cannot be computed with"),
        (PAIRS, (), "501 impacts; expected up to 500"),
        (FALLS.format(power=0) + "".join(f"{0.7**i}\n" for i in range(1, 60)), (), "up to 60 touches"),
    ],
)
def test_numbers_that_nobody_measures_are_refused_by_name(
    text: str, options: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tracebacks of NumPy and SciPy, or computations without an end."""
    (tmp_path / "a.csv").write_text(text)
    assert run(["fit", str(tmp_path / "a.csv"), *options]) == 2
    caught = capsys.readouterr()
    assert re.search(message, caught.err), caught.err
    assert len(caught.err.splitlines()) == 1
    assert caught.out == ""


def test_forces_that_are_no_contact_are_no_law(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One and the same force at each depth is an exponent of 0, which no law has: no line to type next."""
    (tmp_path / "a.csv").write_text(LOOP.format(force=1000))
    assert run(["fit", str(tmp_path / "a.csv")]) == 0
    out = capsys.readouterr().out
    assert "not eq. (16)" in out
    assert "next:" not in out
