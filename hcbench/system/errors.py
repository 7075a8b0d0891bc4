"""Every error that hcbench raises on purpose.

    HcbenchError
    ├── UserError            exit 2: something to correct in what was given
    │   ├── QuantityError      a number or unit
    │   ├── SceneError         a scene folder or its files
    │   ├── StudyError         a study file
    │   └── SettingError       an engine's setting or a recipe's target
    ├── CannotRun            exit 3: nothing wrong with the request, but it could not be carried out
    │   ├── EngineMissing      an engine that is not installed
    │   ├── EngineFailed       an engine that crashed, hung or refused
    │   └── OutputError        a folder or file that could not be written
    └── LimitPassed          exit 1: a measured number is outside the limit that was set

One message is one line of at most LONGEST characters, free of control characters, that names the
slot, what came, what was expected and what to do next.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hcbench.system.text import sanitized

# Characters of a message, at most.
LONGEST = 300


class HcbenchError(Exception):
    """Base of all; `exit_code` is what the command line exits with."""

    exit_code = 3

    def __init__(self, slot: str, got: str, expected: str, advice: str = "") -> None:
        """An error with the message "slot: got; expected ... . advice", in one line.

        slot: the option, key or thing that is wrong.
        got: what came.
        expected: what was expected; "" for a message without it.
        advice: what to do next, a sentence without its point; "" for none. Each is kept whole as an
        attribute; the message is cut to LONGEST characters.
        """
        self.slot = slot
        self.got = got
        self.expected = expected
        self.advice = advice
        parts = []
        for part in (slot, got, expected, advice):
            in_one_line = " ".join(part.split())
            parts.append(sanitized(in_one_line, LONGEST))
        # The longest part gives way until the message fits; cutting it adds three dots.
        while (excess := len(_message(*parts)) - LONGEST) > 0:
            longest = max(parts, key=len)
            i = parts.index(longest)
            parts[i] = sanitized(longest, max(20, len(longest) - excess - 3))
        super().__init__(_message(*parts))

    def __reduce__(self) -> tuple[Any, ...]:
        # Crosses process borders whole: Exception's own pickling keeps the message only.
        return (
            _restored,
            (type(self), self.slot, self.got, self.expected, self.advice),
            self.__dict__,
        )


def _restored(kind: type[HcbenchError], *parts: str) -> HcbenchError:
    """An error of its parts, regardless of what its own __init__ takes."""
    error = kind.__new__(kind)
    HcbenchError.__init__(error, *parts)
    return error


def _message(slot: str, got: str, expected: str, advice: str) -> str:
    message = f"{slot}: {got}; expected {expected}" if expected else f"{slot}: {got}"
    return f"{message}. {advice}" if advice else message


class UserError(HcbenchError):
    """The request has a mistake in it."""

    exit_code = 2


class QuantityError(UserError):
    """A number or unit that cannot be used."""


class PairUnnamed(UserError):  # noqa: N818 - reads as what happened
    """No pair was named, and several of the model can meet."""


class SceneError(UserError):
    """A scene that cannot be read or that contradicts itself."""


class StudyError(UserError):
    """A study file that cannot be read."""


class SettingError(UserError):
    """A setting an engine does not have, or a target a recipe cannot serve."""


class CannotRun(HcbenchError):  # noqa: N818 - reads as what happened
    """The request is fine but could not be carried out here."""


class EngineMissing(CannotRun):
    """The engine is not installed."""


class EngineFailed(CannotRun):
    """The engine crashed, hung or refused the model."""


class OutputError(CannotRun):
    """A file or folder could not be written."""


class LimitPassed(HcbenchError):  # noqa: N818
    """A measured number is outside its limit, or a case has not the verdict that was expected."""

    exit_code = 1


@contextmanager
def foreign_errors(slot: str, *kinds: type[Exception], advice: str = "") -> Iterator[None]:
    """The one gate for errors of other packages: raised within the block, they leave it as
    EngineFailed, in one line; those of hcbench pass as they are.

    slot, advice: of the error.
    kinds: types to catch, whose text says enough; without any, every error is caught, and its type
    is in the message.
    """
    caught = kinds or (Exception,)
    try:
        yield
    except HcbenchError:
        raise
    except caught as error:
        got = str(error) if kinds else typed(error)
        raise EngineFailed(slot, got, "", advice) from error


def typed(error: Exception) -> str:
    """An error of another package with its type, as a message has it."""
    return f"{type(error).__name__}: {error}"
