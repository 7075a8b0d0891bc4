"""Dask schedulers and workers in processes of their own, to be killed."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

# Prints the scheduler's address; each process lasts until it is killed.
SCHEDULER = """
import asyncio, sys
sys.path[:0] = {path!r}
from distributed import Scheduler, Worker

async def run():
    async with Scheduler(host="127.0.0.1", port={port}, dashboard=False) as scheduler:
        async with Worker(scheduler.address, nthreads=1):
            print(scheduler.address, flush=True)
            await scheduler.finished()

asyncio.run(run())
"""
WORKER = """
import asyncio, sys
sys.path[:0] = {path!r}
from distributed import Worker

async def run():
    async with Worker({address!r}, nthreads=1) as worker:
        print("up", flush=True)
        await worker.finished()

asyncio.run(run())
"""


@contextmanager
def running(script: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """A process and the first line that it prints, until the block ends."""
    quiet = subprocess.DEVNULL
    with subprocess.Popen(
        [sys.executable, "-c", script], stdout=subprocess.PIPE, stderr=quiet, text=True
    ) as process:
        try:
            assert process.stdout is not None
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def scheduler(*path: str, port: int = 0) -> str:
    """A script that is a scheduler with one worker."""
    pytest.importorskip("distributed")
    return SCHEDULER.format(path=list(path), port=port)


def kill(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
