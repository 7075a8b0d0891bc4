"""The worker process: what goes in comes out, and no crash, hang or print of an engine gets through."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TYPE_CHECKING

import pytest

from hcbench.errors import EngineFailed, SettingError
from hcbench.workers import process

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

HERE = os.getpid()


def squares(n: int) -> Iterator[int]:
    yield from (i * i for i in range(n))


def process_id() -> Iterator[int]:
    yield os.getpid()


def refuse(slot: str) -> Iterator[int]:
    yield 1
    raise SettingError(slot, "x", "y")


def break_down() -> Iterator[int]:
    yield 1
    raise FileNotFoundError("model.xml")


class Stubborn(Exception):  # noqa: N818 - loses its second argument when pickled
    def __init__(self, a: int, b: int) -> None:
        super().__init__(a)


def break_down_in_its_own_words() -> Iterator[int]:
    yield from ()
    raise Stubborn(1, 2)


def print_much() -> Iterator[str]:
    print("from Python")
    print("to stderr", file=sys.stderr)
    ctypes.CDLL(None).puts(b"from C")
    ctypes.CDLL(None).fflush(None)
    yield "kept"


def halve(
    items: Sequence[int], dies_on: tuple[int, ...] = (), hangs_on: tuple[int, ...] = ()
) -> Iterator[float]:
    for item in items:
        if item in dies_on:
            os.kill(os.getpid(), signal.SIGSEGV)
        while item in hangs_on:
            time.sleep(0.01)
        yield item / 2


def lost(item: int, reason: str) -> float | str:
    return f"{item}: {reason}"


def inside_a_pool() -> tuple[bool, int, int]:
    return process.in_worker(), os.getpid(), process.collect(process_id, limit=60)[0]


def test_values_cross_in_order() -> None:
    assert process.collect(squares, 5, limit=60) == [0, 1, 4, 9, 16]


def test_the_worker_is_another_process_and_is_kept() -> None:
    first, second = (process.collect(process_id, limit=60)[0] for _ in range(2))
    assert first == second != os.getpid()
    assert not process.in_worker()


def test_own_errors_arrive_whole_and_the_worker_goes_on() -> None:
    before = process.collect(process_id, limit=60)
    with pytest.raises(SettingError, match="stiffness: x; expected y"):
        process.collect(refuse, "stiffness", limit=60)
    with pytest.raises(FileNotFoundError, match=r"model\.xml") as error:
        process.collect(break_down, limit=60)
    assert "break_down" in error.value.__notes__[0]  # the worker's traceback
    with pytest.raises(EngineFailed, match="Stubborn: 1"):
        process.collect(break_down_in_its_own_words, limit=60)
    assert process.collect(process_id, limit=60) == before


def test_nothing_that_an_engine_prints_gets_out(capfd: pytest.CaptureFixture[str]) -> None:
    assert process.collect(print_much, limit=60) == ["kept"]
    assert capfd.readouterr() == ("", "")


def test_quiet_silences_c_code_and_gives_the_streams_back(capfd: pytest.CaptureFixture[str]) -> None:
    with process.quiet():
        ctypes.CDLL(None).puts(b"from C, kept in its buffer")
        os.write(2, b"to stderr\n")
    ctypes.CDLL(None).fflush(None)
    os.write(1, b"back\n")
    assert capfd.readouterr() == ("back\n", "")


def test_a_crash_costs_the_item_it_happened_on() -> None:
    found = process.survive(halve, range(6), (0, 3), lost=lost, limit=60)
    assert found == ["0: crashed with SIGSEGV", 0.5, 1.0, "3: crashed with SIGSEGV", 2.0, 2.5]


def test_a_hang_costs_the_item_it_happened_on() -> None:
    began = time.monotonic()
    found = process.survive(halve, [1, *range(2, 50)], (), (1,), lost=lost, limit=1.5)
    assert found == ["1: no answer within 1.5 s", *(i / 2 for i in range(2, 50))]
    assert time.monotonic() - began < 20, "each item has its own limit, however many there are"


def test_what_always_crashes_is_given_up() -> None:
    found = process.survive(halve, range(8), tuple(range(8)), lost=lost, limit=60)
    assert found[:3] == [f"{i}: crashed with SIGSEGV" for i in range(3)]
    assert all("not tried: the engine died on the 3 before it" in str(reason) for reason in found[3:])
    assert len(found) == 8


def test_a_pool_worker_works_in_place() -> None:
    with ProcessPoolExecutor(1, get_context("spawn"), process.enter_worker) as pool:
        inside, pool_worker, worker = pool.submit(inside_a_pool).result(timeout=60)
    assert inside
    assert pool_worker == worker != os.getpid()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_gets_a_worker_of_its_own() -> None:
    ours = process.collect(process_id, limit=60)[0]
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(write, str(process.collect(process_id, limit=60)[0]).encode())
        finally:
            process._shared.close()
            os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        theirs = int(pipe.read())
    os.waitpid(child, 0)
    assert theirs not in (ours, os.getpid())
    assert process.collect(process_id, limit=60) == [ours]


SCRIPT = """
import os, sys, time
from hcbench.workers import process
sys.path.insert(0, {tests!r})
import test_isolation
print(process.collect(test_isolation.process_id, limit=60)[0], flush=True)
{then}
"""


def _script(then: str) -> subprocess.Popen[str]:
    code = SCRIPT.format(tests=os.path.dirname(__file__), then=then)  # noqa: PTH120
    return subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def _gone(process_id: int) -> bool:
    for _ in range(500):
        try:
            os.kill(process_id, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


@pytest.mark.parametrize(
    "then", ["", "process.collect(test_isolation.halve, [1], (), (1,), limit=60)"], ids=["idle", "busy"]
)
def test_an_interrupt_ends_script_and_worker(then: str) -> None:
    with _script(then or "time.sleep(60)") as script:
        assert script.stdout is not None
        worker = int(script.stdout.readline())
        time.sleep(0.2)
        os.kill(worker, signal.SIGINT)  # a terminal tells both
        script.send_signal(signal.SIGINT)
        _, errors = script.communicate(timeout=30)
    assert script.returncode != 0
    assert errors.strip().endswith("KeyboardInterrupt")
    assert _gone(worker)


def test_the_worker_ends_with_a_parent_that_was_killed() -> None:
    with _script("time.sleep(60)") as script:
        assert script.stdout is not None
        worker = int(script.stdout.readline())
        script.kill()
    assert _gone(worker)
