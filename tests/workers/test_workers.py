"""The worker process: what goes in comes out, and no crash, hang or
print of an engine gets through.
"""

from __future__ import annotations

import ctypes
import errno
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TYPE_CHECKING

import pytest

from hcbench.system.errors import CannotRun, EngineFailed, SettingError
from hcbench.workers import (
    WorkerPool,
    call,
    in_worker,
    map_surviving_crashes,
    mark_as_worker,
    process,
    redirect_output,
)

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

HERE = os.getpid()


def square(n: int) -> int:
    return n * n


def process_id(_: int = 0) -> int:
    return os.getpid()


def refuse(slot: str) -> int:
    raise SettingError(slot, "x", "y")


def refuse_a_third(items: Sequence[int]) -> Iterator[int]:
    yield from items[:2]
    raise SettingError("third", "x", "y")


def break_down() -> int:
    raise FileNotFoundError("model.xml")


class Stubborn(Exception):  # noqa: N818 - loses its second argument when pickled
    def __init__(self, a: int, b: int) -> None:
        super().__init__(a)


def break_down_in_its_own_words() -> int:
    raise Stubborn(1, 2)


def answer_with_a_lock() -> object:
    return threading.Lock()  # which cannot be pickled


def print_much() -> str:
    print("from Python")
    print("to stderr", file=sys.stderr)
    ctypes.CDLL(None).puts(b"from C")
    ctypes.CDLL(None).fflush(None)
    return "kept"


def halve(
    items: Sequence[int], dies_on: tuple[int, ...] = (), hangs_on: tuple[int, ...] = ()
) -> Iterator[float]:
    for item in items:
        if item in dies_on:
            os.kill(os.getpid(), signal.SIGSEGV)
        while item in hangs_on:
            time.sleep(0.01)
        yield item / 2


def halve_in_pairs(items: Sequence[int], dies_on: tuple[int, ...]) -> Iterator[float]:
    """Two at once: they come back together, or not at all."""
    for i in range(0, len(items), 2):
        yield from list(halve(items[i : i + 2], dies_on))


def lost(item: int, reason: str) -> float | str:
    return f"{item}: {reason}"


called_first = list[int]()


def remember(n: int) -> None:
    called_first.append(n)


def what_was_called_first(_: int) -> list[int]:
    return called_first


def inside_a_pool() -> tuple[bool, int, int]:
    return in_worker(), os.getpid(), call(process_id, limit=60)


def test_values_cross_in_order() -> None:
    assert call(square, 5, limit=60) == 25
    assert map_surviving_crashes(halve, range(5), lost=lost, limit=60) == [0, 0.5, 1, 1.5, 2]


def test_the_worker_is_another_process_and_is_kept() -> None:
    first, second = (call(process_id, limit=60) for _ in range(2))
    assert first == second != os.getpid()
    assert not in_worker()


def test_own_errors_arrive_whole_and_the_worker_goes_on() -> None:
    before = call(process_id, limit=60)
    with pytest.raises(SettingError, match="stiffness: x; expected y"):
        call(refuse, "stiffness", limit=60)
    with pytest.raises(FileNotFoundError, match=r"model\.xml") as error:
        call(break_down, limit=60)
    assert "break_down" in error.value.__notes__[0]  # the worker's traceback
    with pytest.raises(EngineFailed, match="Stubborn: 1"):
        call(break_down_in_its_own_words, limit=60)
    with pytest.raises(SettingError, match="third: x; expected y"):
        map_surviving_crashes(refuse_a_third, range(5), lost=lost, limit=60)
    with pytest.raises(TypeError, match="pickle"):
        call(answer_with_a_lock, limit=60)
    assert call(process_id, limit=60) == before


def test_nothing_that_an_engine_prints_gets_out(capfd: pytest.CaptureFixture[str]) -> None:
    assert call(print_much, limit=60) == "kept"
    assert capfd.readouterr() == ("", "")


def test_quiet_silences_c_code_and_gives_the_streams_back(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with redirect_output():
        ctypes.CDLL(None).puts(b"from C, kept in its buffer")
        os.write(2, b"to stderr\n")
    ctypes.CDLL(None).fflush(None)
    os.write(1, b"back\n")
    assert capfd.readouterr() == ("back\n", "")


def test_a_crash_costs_the_item_it_happened_on() -> None:
    found = map_surviving_crashes(halve, range(6), (0, 3), lost=lost, limit=60)
    assert found == ["0: crashed with SIGSEGV", 0.5, 1.0, "3: crashed with SIGSEGV", 2.0, 2.5]


def test_a_hang_costs_the_item_it_happened_on() -> None:
    began = time.monotonic()
    found = map_surviving_crashes(halve, [1, *range(2, 50)], (), (1,), lost=lost, limit=1.5)
    assert found == ["1: no answer within 1.5 s", *(i / 2 for i in range(2, 50))]
    assert time.monotonic() - began < 20, "each item has its own limit, however many there are"


def burn(seconds: float) -> float:
    """Keep a processor busy for some time of the clock."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        pass
    return seconds


def test_a_process_at_work_is_given_up_after_the_longest_time_of_the_clock() -> None:
    with pytest.raises(EngineFailed, match=r"no answer within 0\.5 s"):
        call(burn, 600.0, limit=600.0, longest=0.5)
    assert call(burn, 0.1, limit=600.0, longest=60.0) == 0.1


def test_a_process_that_cannot_start_is_told_with_the_reason(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse_to_start(*_: object, **__: object) -> None:
        raise OSError(errno.ENOMEM, "Cannot allocate memory")

    worker = process.Worker()
    monkeypatch.setattr(subprocess, "Popen", refuse_to_start)
    with pytest.raises(process.WorkerDied, match=r"did not start: .*Cannot allocate memory"):
        worker.run(refuse_a_third, ([1],), None)


def test_what_always_crashes_is_given_up() -> None:
    found = map_surviving_crashes(halve, range(8), tuple(range(8)), lost=lost, limit=60)
    assert found[:3] == [f"{i}: crashed with SIGSEGV" for i in range(3)]
    assert all(
        "not tried: the engine died on the 3 before it" in str(reason) for reason in found[3:]
    )
    assert len(found) == 8


def test_a_crash_of_several_at_once_costs_the_one_it_comes_from() -> None:
    found = map_surviving_crashes(halve_in_pairs, range(8), (1, 4), lost=lost, limit=60, together=2)
    assert found == [0, "1: crashed with SIGSEGV", 1, 1.5, "4: crashed with SIGSEGV", 2.5, 3, 3.5]


def test_a_pool_has_as_many_processes_as_jobs_and_keeps_the_order() -> None:
    with WorkerPool(2) as pool:
        assert pool.map(square, range(20)) == [i * i for i in range(20)]
        processes = set(pool.map(process_id, range(20)))
    assert 1 <= len(processes) <= 2
    assert os.getpid() not in processes
    assert all(_gone(process) for process in processes)


def test_a_pool_of_a_million_jobs_starts_two_processes_a_core_at_most() -> None:
    most = 2 * (os.cpu_count() or 1)
    with WorkerPool(1_000_000) as pool:
        assert pool.jobs == most
        pool.begin(__name__, "remember", 7)
        assert len(set(pool.map(process_id, range(4 * most)))) <= most


def die(_: int) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_pool_that_is_begun_calls_its_start_function_before_any_job() -> None:
    with WorkerPool(2) as pool:
        pool.begin(__name__, "remember", 7)
        assert pool.map(what_was_called_first, [0, 0]) == [[7], [7]]
    with WorkerPool(1) as pool:
        pool.begin(__name__, "break_down")
        assert pool.map(square, [3]) == [9]


def test_a_pool_that_loses_a_process_says_so_in_one_line() -> None:
    with (
        WorkerPool(1) as pool,
        pytest.raises(CannotRun, match="process died: crashed with SIGKILL"),
    ):
        pool.map(die, range(2))


def test_a_pool_that_is_left_by_an_error_kills_what_it_does() -> None:
    began = time.monotonic()
    with pytest.raises(ZeroDivisionError), WorkerPool(2) as pool:
        pool.threads.submit(call, time.sleep, 600, limit=600)
        processes = pool.map(process_id, range(1))
        raise ZeroDivisionError
    assert time.monotonic() - began < 30
    assert all(_gone(process) for process in processes)


def test_a_pool_worker_works_in_place() -> None:
    with ProcessPoolExecutor(1, get_context("spawn"), mark_as_worker) as pool:
        inside, pool_worker, worker = pool.submit(inside_a_pool).result(timeout=60)
    assert inside
    assert pool_worker == worker != os.getpid()


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_gets_a_worker_of_its_own() -> None:
    ours = call(process_id, limit=60)
    read, write = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.write(write, str(call(process_id, limit=60)).encode())
        finally:
            process._shared.close()
            os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        theirs = int(pipe.read())
    os.waitpid(child, 0)
    assert theirs not in (ours, os.getpid())
    assert call(process_id, limit=60) == ours


SCRIPT = """
import os, sys, time
from hcbench.workers import call
sys.path.insert(0, {tests!r})
import test_workers
print(call(test_workers.process_id, limit=60), flush=True)
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


@pytest.mark.parametrize("then", ["", "call(time.sleep, 60, limit=60)"], ids=["idle", "busy"])
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


FORKED = """
import contextlib, os, signal, sys
sys.path.insert(0, {tests!r})
import test_workers as tests
from hcbench.system.process import IS_COMMAND
from hcbench.system.errors import EngineFailed
from hcbench.workers import begin, call
IS_COMMAND.set(True)
signal.signal(signal.SIGTERM, lambda *_: None)
tests.called_first.append(0)
begin("test_workers", "remember", 1)
print(call(tests.what_was_called_first, 0, limit=60), call(tests.process_id, limit=60) != os.getpid())
os.kill(call(tests.process_id, limit=60), signal.SIGTERM)
for _ in range(2):  # the first may find it dying
    with contextlib.suppress(EngineFailed):
        fresh = call(tests.what_was_called_first, 0, limit=60)
print(fresh)
"""


@pytest.mark.skipif(not process.CAN_FORK, reason="this system has no safe fork")
def test_a_worker_that_is_begun_has_what_its_parent_imported_and_ends_by_its_own_signals() -> None:
    code = FORKED.format(tests=os.path.dirname(__file__))  # noqa: PTH120
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.splitlines() == ["[0, 1] True", "[]"]
