"""Forces over time and over penetration."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from measured_bounces import synthesise, write
from scipy.integrate import solve_ivp
from scipy.signal import butter, lfilter

import hcbench as hb
from hcbench.cli import run
from hcbench.system.errors import UserError

K, N, ALPHA, MASS = 3e7, 1.5, 0.3, 0.45


def pushed(speed: float, alpha: float = ALPHA) -> tuple[np.ndarray, ...]:
    """(time, penetration, rate, force) of one impact of eq. (16), by an ODE."""

    def rate(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -K * max(y[0], 0.0) ** N * (1 + 1.5 * alpha * y[1]) / MASS]

    done = solve_ivp(
        rate, (0, 4e-3), [0.0, speed], rtol=1e-10, atol=1e-13, max_step=1e-5, dense_output=True
    )
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
        noisy = (
            12.0
            + np.concatenate([np.zeros(300), f])
            + 4e-3 * f.max() * rng.standard_normal(300 + len(f))
        )
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


def test_a_push_of_most_of_its_record_has_its_zero_at_the_ends(tmp_path: Path) -> None:
    """A push longer than the quiet about it: the median of the record lies in the push."""
    *_, force = pushed(0.8)
    last = int(np.flatnonzero(force)[-1])
    noise = 2e-3 * force.max() * np.random.default_rng(2).standard_normal(last + 40)
    record = 3.0 + np.concatenate([np.zeros(20), force[: last + 20]]) + noise
    text = "".join(f"{1e-5 * i:.5f},{f:.3f}\n" for i, f in enumerate(record))
    (tmp_path / "push.csv").write_text(f"mass of ball,450 g\n\ntime [s],force [N]\n{text}")
    found = hb.fit_force(tmp_path / "push.csv", mass=MASS, speed=0.8)
    assert found.alpha_interval[0] < ALPHA < found.alpha_interval[1] < 1.5 * ALPHA
    with pytest.raises(UserError, match="'mass of ball,450 g': give mass '450 g'"):
        hb.fit_force(tmp_path / "push.csv", speed=0.8)
    # Cut within the push, the ends say nothing of the zero.
    cut = "".join(f"{1e-5 * i:.5f},{f:.3f}\n" for i, f in enumerate(record[60:-60]))
    (tmp_path / "push.csv").write_text(f"time [s],force [N]\n{cut}")
    with pytest.raises(UserError, match=r"quiet|push"):
        hb.fit_force(tmp_path / "push.csv", mass=MASS, speed=0.8)


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


LOOP = "penetration [um],rate [m/s],force [N]\n" + "".join(
    f"{10 * math.sin(0.05 * i):.6g},{0.5 * math.cos(0.05 * i):.6g},{{force}}\n"
    for i in range(1, 60)
)


def test_forces_that_are_no_contact_are_no_law(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One and the same force at each depth is an exponent of 0, which no
    law has: no line to type next.
    """
    (tmp_path / "a.csv").write_text(LOOP.format(force=1000))
    assert run(["fit", str(tmp_path / "a.csv")]) == 0
    out = capsys.readouterr().out
    assert "not Hunt and Crossley's" in out
    assert "next:" not in out


def test_a_shape_that_contradicts_its_impulse_leaves_the_impulses_restitution(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An amplifier of 300 Hz smears a push of 1.6 ms, and leaves its impulse as it was."""
    *_, f = pushed(0.8)
    smeared = lfilter(*butter(1, 300.0, fs=1e5), np.concatenate([np.zeros(900), f, np.zeros(1200)]))
    noisy = smeared + 2e-3 * f.max() * np.random.default_rng(1).standard_normal(len(smeared))
    rows = "\n".join(f"{1e-2 * i:.5f},{b:.4f}" for i, b in enumerate(noisy))
    path = write(tmp_path, f"time [ms],force [N]\n{rows}\n")
    words = ["fit", path, "--mass", "0.45 kg", "--speed", "0.8 m/s"]
    assert run(words) == 0
    out = capsys.readouterr().out
    assert (
        "by the impulse" in out
        and "by the pulse's shape: they contradict" in out
        and "next:" not in out
    )
    assert run([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["shape_contradicts_impulse"] and found["law"] is None
    low, high = found["restitution_interval_95"]
    truth = synthesise.hunt_crossley(ALPHA)(0.8)
    assert low < truth < high and 0.001 < high - low < 0.1
    assert abs(found["restitution_by_shape"] - truth) > 0.01


def test_a_rate_of_the_wrong_sign_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, x, v, f = pushed(0.8)
    path = tmp_path / "loop.csv"
    lines = [f"{1e6 * a:.4f},{-b:.5f},{c:.3f}" for a, b, c in zip(x, v, f, strict=True) if a > 0]
    path.write_text("penetration [um],rate [m/s],force [N]\n" + "\n".join(lines) + "\n")
    assert run(["fit", str(path)]) == 2
    assert "sign of the rate" in capsys.readouterr().err
