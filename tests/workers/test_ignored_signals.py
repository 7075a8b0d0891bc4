"""A parent may leave SIGCHLD ignored: the system then keeps no exit status of a child."""

import signal
import sys
import time
from collections.abc import Iterator

import pytest

from hcbench.workers.process import CAN_FORK, Fork

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="forks are for Linux")


@pytest.fixture
def _ignored() -> Iterator[None]:
    before = signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    yield
    signal.signal(signal.SIGCHLD, before)


@pytest.mark.usefixtures("_ignored")
@pytest.mark.parametrize("function", [lambda: None, lambda: sys.exit(1), lambda: time.sleep(60)])
def test_a_copy_ends_without_its_exit_status(function: object) -> None:
    fork = Fork(function)  # type: ignore[arg-type]
    fork.kill()
    assert fork.wait(timeout=20.0) == 0
    assert fork.poll() == 0
    assert fork.wait() == 0


def test_a_copy_that_was_killed_says_so_otherwise() -> None:
    fork = Fork(lambda: time.sleep(60))
    fork.kill()
    assert fork.wait(timeout=20.0) == -signal.SIGKILL
