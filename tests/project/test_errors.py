"""Exceptions of the package cross process borders whole: every class, pickled and unpickled."""

from __future__ import annotations

import importlib
import pickle
import pkgutil
from collections.abc import Iterator

import pytest

import hcbench
from hcbench.recipes.recipe import SearchInterrupted
from hcbench.system.compiler import NotCompiled
from hcbench.system.errors import HcbenchError

PARTS = ("slot", "what came", "what was expected", "what to do")


def _below(kind: type[BaseException]) -> Iterator[type[BaseException]]:
    for each in kind.__subclasses__():
        yield each
        yield from _below(each)


def _own() -> list[type[BaseException]]:
    """Every exception class of the package, warnings apart."""
    for module in pkgutil.walk_packages(hcbench.__path__, "hcbench."):
        if not module.name.endswith("__main__"):
            try:
                importlib.import_module(module.name)
            except ImportError:  # of an engine that is not installed
                continue
    kinds = {kind for kind in _below(BaseException) if kind.__module__.split(".")[0] == "hcbench"}
    return sorted(
        (kind for kind in kinds if not issubclass(kind, Warning)), key=lambda kind: kind.__name__
    )


def _made(kind: type[BaseException]) -> BaseException:
    if kind is SearchInterrupted:
        return SearchInterrupted("best", 0.25, 3, 4)
    if kind is NotCompiled:
        return NotCompiled("no C compiler found")
    return kind(*PARTS) if issubclass(kind, HcbenchError) else kind("text")


@pytest.mark.parametrize("kind", _own(), ids=lambda kind: kind.__name__)
def test_an_exception_is_the_same_after_pickling(kind: type[BaseException]) -> None:
    error = _made(kind)
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is kind
    assert str(again) == str(error)
    assert vars(again) == vars(error)
    assert getattr(again, "exit_code", None) == getattr(error, "exit_code", None)
