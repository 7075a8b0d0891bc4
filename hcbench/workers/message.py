"""Messages between a worker process and its parent, which may run different versions of Python."""

import copyreg
import io
import pickle
import traceback
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hcbench.system.errors import EngineFailed, HcbenchError, typed

# Default of Python 3.11, the oldest that may be at the other end.
_PROTOCOL = 4
# A module, a function of it, and arguments.
FirstCall = tuple[str, str, tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class CallEnd:
    """Message of a worker after the results of a request."""

    error: Exception | None


def pickled(value: Any) -> bytes:
    """A value as every Python from 3.11 on reads it."""
    buffer = io.BytesIO()
    pickler = pickle.Pickler(buffer, _PROTOCOL)
    # Paths cross as text: Python 3.13 has their class in a module that others lack.
    pickler.dispatch_table = {**copyreg.dispatch_table, type(Path()): _reduced}
    pickler.dump(value)
    return buffer.getvalue()


def _reduced(path: Path) -> tuple[Any, tuple[str]]:
    return as_path, (str(path),)


def as_path(text: str) -> Path:
    """The path as this Python has it."""
    return Path(text)


def portable(error: Exception) -> Exception:
    """An error of Python's own or of hcbench as it is, any other in words.

    Other packages' errors do not cross: to read one, the parent would have to import the engine.
    """
    package = type(error).__module__.partition(".")[0]
    if package not in ("builtins", "hcbench"):
        return EngineFailed("engine", typed(error), "")
    if not isinstance(error, HcbenchError):
        error.add_note("".join(traceback.format_exception(error)))
    return error
