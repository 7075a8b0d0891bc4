"""Functions in a user's Python file, named as "file.py:function"."""

from __future__ import annotations

import re
import runpy
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hcbench.system.errors import HcbenchError, UserError

_PYTHON = re.compile(r"(?P<file>.+\.py):(?P<function>[A-Za-z_]\w*)")


def is_python(source: Any) -> bool:
    """Say whether a text names a function of a Python file."""
    return isinstance(source, str) and _PYTHON.fullmatch(source) is not None


def python_function(text: str) -> Callable[..., Any]:
    """The function that "file.py:function" names. Raises UserError where it is missing."""
    match = _PYTHON.fullmatch(text)
    assert match is not None
    path = Path(match["file"])
    name = match["function"]
    if not path.is_file():
        raise UserError("model", f"{path} is not there", "a Python file")
    with _user_code(f"{path}", "a file that runs"):
        names = runpy.run_path(str(path))
    if name not in names:
        raise UserError("model", f"{path} has no {name!r}", "the name of a function in it")
    function: Callable[..., Any] = names[name]
    return function


def call_python(text: str) -> Any:
    """Call the function of a Python file and return its result."""
    function = python_function(text)
    with _user_code(text, "a function without arguments that returns a model"):
        return function()


@contextmanager
def _user_code(where: str, expected: str) -> Iterator[None]:
    """Errors of a user's own code as UserError."""
    try:
        yield
    except (HcbenchError, MemoryError):
        raise
    except (Exception, SystemExit) as error:
        raise UserError("model", f"{where}: {type(error).__name__}: {error}", expected) from None
