"""Work for hcbench's worker processes, done in the process of the test.

A new process imports for half a second what a small study takes a hundredth of a second for. Tests
that say something about processes start them all the same.
"""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

import mujoco
import pytest

from hcbench.workers import serve

if TYPE_CHECKING:
    from collections.abc import Iterator


@contextmanager
def in_place() -> Iterator[None]:
    """Start no worker process meanwhile.

    For one job: engines in several threads would share what belongs to a process.
    """
    handler = mujoco.get_mju_user_warning()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(serve, "_is_worker", True)
        yield
    mujoco.set_mju_user_warning(handler)
