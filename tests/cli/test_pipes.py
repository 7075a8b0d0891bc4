"""Inputs that are pipes: the shell's own are read, any other is refused, and none is waited for."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import hcbench as hb
from hcbench.system.errors import HcbenchError
from hcbench.system.files import open_input, read_bytes, why_no_file

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")


@pytest.fixture
def fifo(tmp_path: Path) -> Callable[[str], Path]:
    def make(name: str) -> Path:
        os.mkfifo(tmp_path / name)
        return tmp_path / name

    return make


def _read_toml(path: Path) -> Any:
    from hcbench.checking.text import find_table

    return find_table(path)


def _read_state(path: Path) -> Any:
    from hcbench.measuring.request import read_state

    return read_state(path)


def _read_baseline(path: Path) -> Any:
    from hcbench.checking.baseline import read_baseline

    return read_baseline(path, "all")


def _fit(path: Path) -> Any:
    from hcbench.fitting.ask import fit

    return fit(path)


def _replay(path: Path) -> Any:
    from hcbench.engines.recorded import read

    return read(path)


READERS = {
    "checks.toml": _read_toml,
    "state.json": _read_state,
    "state.npz": _read_state,
    "baseline.json": _read_baseline,
    "times.csv": _fit,
    "times.wav": _fit,
    "times.m4a": _fit,
    "recorded.csv": _replay,
}


@pytest.mark.parametrize("name", READERS)
def test_a_pipe_with_a_name_is_refused_at_once(name: str, fifo: Callable[[str], Path]) -> None:
    """A pipe has no writer here: a reader that opened it would wait for good."""
    with pytest.raises(HcbenchError, match="not a file") as caught:
        READERS[name](fifo(name))
    assert "Errno" not in str(caught.value)


def test_a_device_without_an_end_is_refused(tmp_path: Path) -> None:
    link = tmp_path / "zero"
    link.symlink_to("/dev/zero")
    with pytest.raises(OSError, match="not a file"):
        read_bytes(link)
    assert why_no_file(link) == "is not a file that can be read again"
    (tmp_path / "dangling").symlink_to(tmp_path / "nothing")
    assert why_no_file(tmp_path / "dangling") == "is a link that leads to no file"


def test_a_pipe_that_this_process_was_given_is_read() -> None:
    end, begin = os.pipe()
    os.write(begin, b"content")
    os.close(begin)
    try:
        with open_input(Path(f"/dev/fd/{end}")) as file:
            assert file.read() == b"content"
    finally:
        os.close(end)


TIMES = b"time [s]\n0\n0.286\n0.488\n0.643\n0.77\n"


@pytest.fixture
def pipe() -> Iterator[Callable[[bytes], str]]:
    opened = []

    def make(content: bytes) -> str:
        reader, writer = os.pipe()
        os.write(writer, content)
        os.close(writer)
        opened.append(reader)
        return f"/dev/fd/{reader}"

    yield make
    for reader in opened:
        os.close(reader)


def test_a_pipe_is_fitted_as_its_content_in_a_file_is(
    pipe: Callable[[bytes], str], tmp_path: Path
) -> None:
    file = tmp_path / "times.csv"
    file.write_bytes(TIMES)
    assert hb.fit(pipe(TIMES)).speeds == hb.fit(file).speeds


def test_a_pipe_is_read_once_and_each_pipe_has_its_own_content(
    pipe: Callable[[bytes], str],
) -> None:
    one = Path(pipe(b"one"))
    other = Path(pipe(b"other"))
    assert [read_bytes(path) for path in (one, other, one)] == [b"one", b"other", b"one"]


def test_a_recording_in_a_pipe_is_to_be_saved_to_a_file(pipe: Callable[[bytes], str]) -> None:
    with pytest.raises(HcbenchError, match="Save what the pipe brings to a file"):
        hb.fit(pipe(b"RIFF\0\0\0\0WAVE\x81\xff"))


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_fit_reads_standard_input(name: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", "hcbench", "fit", name, "--json"],
        input=TIMES,
        capture_output=True,
        timeout=300,
        check=False,
    )
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert b'"alpha_s_per_m"' in ran.stdout
