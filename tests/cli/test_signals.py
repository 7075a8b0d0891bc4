"""Ctrl-C, TERM and HUP: one line, exit 130, no process left, nothing half-written."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hcbench.benchmark.store import Store, open_files
from hcbench.cli import _process, run

PROC = Path("/proc")
pytestmark = pytest.mark.skipif(
    not (PROC / "self" / "stat").exists(), reason="no /proc to find processes in"
)

HCBENCH = [sys.executable, "-m", "hcbench"]
LONG = """scene = "steel-plane"
alphas = 0.3
speeds = "0.05:0.5:2000"
phases = {phases}
[[run]]
engine = "reference"
recipe = "hunt-crossley"
timesteps = {timestep}
"""
HANGS = "import time\ndef model():\n    time.sleep(600)\n"
PATIENCE_S = 60.0


def session(leader: int) -> list[int]:
    """The processes of a session that still run."""
    found = []
    for folder in PROC.iterdir():
        if folder.name.isdigit():
            try:
                state, _, _, own = (folder / "stat").read_text().rpartition(")")[2].split()[:4]
            except OSError:
                continue  # gone
            if int(own) == leader and state != "Z":
                found.append(int(folder.name))
    return found


def wait_for(what: str, true: object) -> None:
    end = time.monotonic() + PATIENCE_S
    while not true():  # type: ignore[operator]
        assert time.monotonic() < end, f"waited in vain for {what}"
        time.sleep(0.02)


def start(arguments: list[str], folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*HCBENCH, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=hang_up_ends,  # noqa: PLW1509 (nothing here has threads)
    )


def hang_up_ends() -> None:
    """The terminal's end ends the command, also where the tests themselves run under nohup."""
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def end(process: subprocess.Popen[str], number: signal.Signals) -> None:
    """Send a signal as it comes in life: Ctrl-C to all in the
    terminal, others to the command alone.
    """
    (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
    begin = time.monotonic()
    out, err = process.communicate(timeout=PATIENCE_S)
    assert time.monotonic() - begin < 10.0
    assert process.returncode == 130
    assert (out, err) == ("", "hcbench: interrupted; nothing was left half-written\n")
    wait_for("the last process to end", lambda: not session(process.pid))


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP], ids=lambda n: n.name
)
def test_a_report_that_is_interrupted_leaves_nothing(
    tmp_path: Path, number: signal.Signals
) -> None:
    (tmp_path / "study.toml").write_text(LONG.format(phases=1000, timestep=1e-8), encoding="utf-8")
    process = start(["report", "study.toml", "--out", "reports/mine", "--jobs", "2"], tmp_path)
    wait_for("its workers", lambda: len(session(process.pid)) >= 3)
    end(process, number)
    assert [path.name for path in tmp_path.iterdir()] == ["study.toml"]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_sweep_that_is_interrupted_leaves_whole_parts(
    tmp_path: Path, number: signal.Signals
) -> None:
    (tmp_path / "study.toml").write_text(LONG.format(phases=80, timestep=1e-5), encoding="utf-8")
    process = start(["sweep", "study.toml", "--out", "mine", "--jobs", "2"], tmp_path)
    wait_for("a part", lambda: list((tmp_path / "mine").glob("part-*")))
    end(process, number)
    files = [path.name for path in (tmp_path / "mine").rglob("*") if path.is_file()]
    assert all(
        re.match(r"part-|loops-|_sweep\.json|_summary\.csv|_lock", name) for name in files
    ), files
    shards = list(Store(open_files(str(tmp_path / "mine"))).verified(10**7))
    assert shards
    assert all(summary is not None for _, summary in shards), "none is damaged"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize("command", ["check", "measure"])
def test_a_model_that_hangs_is_left_alone_when_interrupted(
    tmp_path: Path, command: str, number: signal.Signals
) -> None:
    (tmp_path / "hangs.py").write_text(HANGS, encoding="utf-8")
    target = ["--measure-only"] if command == "check" else []
    process = start(
        [command, "--python", "hangs.py:model", "--pair", "ball,plate", *target], tmp_path
    )
    wait_for("its worker", lambda: len(session(process.pid)) >= 2)
    end(process, number)


def test_what_is_ignored_stays_ignored(tmp_path: Path) -> None:
    """A command under nohup outlives its terminal."""
    (tmp_path / "hangs.py").write_text(HANGS, encoding="utf-8")
    script = (
        "import signal, runpy; signal.signal(signal.SIGHUP, signal.SIG_IGN);"
        + "from hcbench.cli import main; main()"
    )
    arguments = ["check", "--python", "hangs.py:model", "--pair", "ball,plate", "--measure-only"]
    with subprocess.Popen(
        [sys.executable, "-c", script, *arguments],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        wait_for("its worker", lambda: len(session(process.pid)) >= 2)
        process.send_signal(signal.SIGHUP)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(timeout=1.0)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=PATIENCE_S) == 130


def test_a_search_has_a_bar_and_its_best_is_printed_on_ctrl_c(tmp_path: Path) -> None:
    import pty

    arguments = [
        "tune",
        "mujoco",
        "--alpha",
        "0.008 s/in",
        "--timestep",
        "1e-6",
        "--recipe",
        "soft",
    ]
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        [*HCBENCH, *arguments],
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        start_new_session=True,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "NO_COLOR": "1"},
    ) as process:
        os.close(theirs)
        seen = b""
        while (found := re.search(rb"(\d\d+)/1650", seen)) is None:
            seen += os.read(ours, 4096)
        os.killpg(process.pid, signal.SIGINT)
        assert process.stdout is not None
        out = process.stdout.read()
        try:
            while more := os.read(ours, 4096):
                seen += more
        except OSError:
            pass  # the other end has been closed
        os.close(ours)
        assert process.wait(timeout=PATIENCE_S) == 130
    assert "the best so far" in out
    assert "solref=" in out
    told = re.search(
        rb"hcbench: interrupted: the search was cut short after (\d+) of at most 1650", seen
    )
    assert told is not None
    assert int(told[1]) >= int(found[1])


def caught(process: int) -> int:
    """The signals that a process has handlers for, a bit each."""
    match = re.search(r"SigCgt:\s*(\w+)", (PROC / str(process) / "status").read_text())
    return int(match[1], 16) if match else 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.2, 0.4, 0.8])
def test_a_command_ends_in_one_line_from_its_first_instant_on(
    tmp_path: Path, number: signal.Signals, delay: float
) -> None:
    """A traceback, once, while its modules were read. Before Python
    itself is there, the system ends it.
    """
    (tmp_path / "hangs.py").write_text(HANGS, encoding="utf-8")
    process = start(["measure", "--python", "hangs.py:model", "--pair", "ball,plate"], tmp_path)
    wait_for("its handlers", lambda: caught(process.pid) & 1 << signal.SIGTERM - 1)
    time.sleep(delay)
    begin = time.monotonic()
    os.kill(process.pid, number)
    out, err = process.communicate(timeout=PATIENCE_S)
    assert time.monotonic() - begin < 1.0 + 0.5 * os.getloadavg()[0]
    assert (process.returncode, out) == (130, "")
    assert err == "hcbench: interrupted; nothing was left half-written\n"


@pytest.fixture
def handlers(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The command's handlers in this process."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGALRM")
    before = {name: signal.getsignal(getattr(signal, name)) for name in names}
    monkeypatch.setattr(_process, "INTERRUPTS", _process._Interrupts())
    monkeypatch.setattr("hcbench.cli.INTERRUPTS", _process.INTERRUPTS)
    monkeypatch.setattr(sys, "unraisablehook", sys.unraisablehook)
    _process.install_signal_handlers()
    yield
    for name, handler in before.items():
        signal.signal(getattr(signal, name), handler)


class Deaf:
    """An interrupt that falls here is ignored by Python."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)


@pytest.mark.usefixtures("handlers")
def test_an_interrupt_that_python_ignores_comes_again() -> None:
    """Once, `measure` went on for a minute: the interrupt fell into
    the callback of a module's lock.
    """
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        Deaf()
        time.sleep(10.0)
    assert time.monotonic() - begin < 5.0


@pytest.mark.usefixtures("handlers")
def test_an_interrupt_of_which_python_makes_another_error_is_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A class that is being made tells RuntimeError, an import KeyError."""

    class Name:
        def __set_name__(self, owner: type, name: str) -> None:
            signal.raise_signal(signal.SIGINT)

    def interrupted(*args: object) -> None:
        type("Owner", (), {"field": Name()})

    monkeypatch.setattr("hcbench.laws.closed_form.restitution", interrupted)
    assert run(["law", "--alpha", "0.1", "--speeds", "0.1"]) == 130
    assert capsys.readouterr().err == "hcbench: interrupted; nothing was left half-written\n"


@pytest.mark.usefixtures("handlers")
def test_an_interrupt_in_an_import_waits_for_its_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`tune mujoco` went on: MuJoCo's own import made an ImportError of
    it, and that a missing engine.
    """
    text = "import signal\ntry:\n  signal.raise_signal(signal.SIGINT)\nexcept BaseException:\n  lost = True\n"
    (tmp_path / "swallows.py").write_text(text, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(KeyboardInterrupt):
        assert not hasattr(__import__("swallows"), "lost")
        time.sleep(10.0)
