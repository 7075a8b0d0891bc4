"""The other end of isolation: the worker process, and how the two talk."""

from __future__ import annotations

import os
import pickle
import struct
import traceback
from enum import Enum, auto
from typing import IO, Any, NoReturn

from hcbench.errors import EngineFailed, HcbenchError

_SIZE = struct.Struct("<Q")


class Answer(Enum):
    """What a worker says."""

    READY = auto()
    ITEM = auto()
    RAISED = auto()
    END = auto()


def send(pipe: IO[bytes] | None, value: Any) -> None:
    """One value into a pipe."""
    assert pipe is not None
    data = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
    pipe.write(_SIZE.pack(len(data)) + data)
    pipe.flush()


def receive(pipe: IO[bytes] | None) -> Any:
    """One value out of a pipe; EOFError where the other end has gone."""
    return pickle.loads(_receive_bytes(pipe))


def _receive_bytes(pipe: IO[bytes] | None) -> bytes:
    assert pipe is not None
    head = pipe.read(_SIZE.size)
    if len(head) == _SIZE.size:
        (size,) = _SIZE.unpack(head)
        data = pipe.read(size)
        if len(data) == size:
            return data
    raise EOFError


def serve() -> NoReturn:
    """The worker's main loop: answers requests on the pipes it was started with, until they close."""
    from hcbench.workers.process import enter_worker

    enter_worker()
    requests = os.fdopen(os.dup(0), "rb")
    answers = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_RDWR)
    for fd in (0, 1, 2):  # what engines print is not part of the conversation
        os.dup2(nowhere, fd)

    def say(kind: Answer, value: Any = None) -> None:
        try:
            send(answers, (kind, value))
        except OSError:
            os._exit(0)  # the parent has gone

    say(Answer.READY)
    while True:
        try:
            request = _receive_bytes(requests)
        except (EOFError, OSError):
            os._exit(0)
        try:
            place, function, args = pickle.loads(request)
            os.chdir(place)  # the parent's: relative paths mean the same here
            for item in function(*args):
                say(Answer.ITEM, item)
        except Exception as error:
            say(Answer.RAISED, _portable(error))
        else:
            say(Answer.END)


def _portable(error: Exception) -> Exception:
    """An error of Python's own or of hcbench as it is, any other in words.

    Other packages' errors do not cross: to read one, the parent would have to import the engine.
    """
    home = type(error).__module__.partition(".")[0]
    if home not in ("builtins", "hcbench"):
        return EngineFailed("engine", f"{type(error).__name__}: {error}", "")
    if not isinstance(error, HcbenchError):
        error.add_note("".join(traceback.format_exception(error)))
    return error
