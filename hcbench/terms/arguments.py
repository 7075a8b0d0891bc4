"""Arguments of public functions and classes, held to their annotations: a
mistake is a UserError by name.

Pydantic's `validate_call` was tried instead. Not strict, it reads "0.3" as a number without a unit,
and True as 1; strict, it refuses NumPy's integers, a list for a tuple or an array, and hands arrays
on as iterators. It cannot read the names that are imported for type checkers alone, nor
`typing.TypedDict` before Python 3.12. Verbs that read no files of settings, such as `law` and
`fit`, would import it for this alone.
"""

import functools
import inspect
import operator
import re
import types
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import (
    Annotated,
    Any,
    Literal,
    ParamSpec,
    TypeVar,
    Union,
    Unpack,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from hcbench.system.errors import HcbenchError, UserError
from hcbench.system.process import NAMES_OPTIONS
from hcbench.system.text import shown
from hcbench.terms.options import (
    RENAMED,
    BodyPair,
    Controller,
    PintQuantity,
    Quantity,
    hint_at,
)
from hcbench.terms.units import is_real

P = ParamSpec("P")
R = TypeVar("R")
C = TypeVar("C", bound=type)

_Parts = tuple[Any, ...]
_LARGEST_FLOAT = int(np.finfo(float).max)
# Engines keep integers in 32 bits.
_LARGEST_INT = 2**31 - 1
_WORDS = {
    float: "a number",
    int: "a whole number",
    bool: "True or False",
    str: "text",
    Path: "a path",
    type(None): "None",
    PintQuantity: "a quantity of Pint's",
    Quantity: "a number, or text with a unit",
    BodyPair: "two names, first the one that moves",
    Controller: "pd, ctrl, file.py:function, or a function",
}

_OPTION = re.compile(r"--([a-z]+(?:-[a-z]+)*)")
_BEYOND_BOUNDS = "`with hcbench.beyond_bounds():`"
# Options that have another name in Python.
_PARAMETERS = {
    "as": ("kind",),
    "for": ("version",),
    "from": ("coming_from", "begin"),
    "no-actuators": ("actuators=False",),
    "to": ("end",),
}


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a function so that it checks its arguments. NumPy numbers become
    Python's; an argument of another type than annotated, of an unknown name, that is missing or
    one too many raises a UserError that names it.

    Errors of hcbench that the function raises name its parameters, not options of commands.
    """
    signature = _spelled_out(function)
    names = signature.parameters
    # Parameters that a call may give by place, `*rest` after them, and whether it has `**rest`.
    in_places: list[str] = []
    after_them: list[str] = []
    takes_others = False
    for name, parameter in names.items():
        if parameter.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD:
            in_places.append(name)
        elif parameter.kind is inspect.Parameter.VAR_POSITIONAL:
            after_them.append(name)
        elif parameter.kind is inspect.Parameter.VAR_KEYWORD:
            takes_others = True

    @functools.wraps(function)
    def outer(*args: P.args, **kwargs: P.kwargs) -> R:
        """Call the function with its arguments checked. Its own docstring takes this one's place."""
        # Types are read at the first call: at import some are not defined yet.
        hints = _hints(function)
        # Each argument of `*files` counts as one of them.
        places = [*in_places, *after_them * len(args)]
        plain_args = list(map(_plain, args))
        plain = {name: _plain(value) for name, value in kwargs.items()}
        for old in RENAMED.keys() & plain.keys() - names.keys():
            hint_at(old, RENAMED[old])
            plain.setdefault(RENAMED[old], plain.pop(old))
        given = [*zip(places, plain_args, strict=False), *plain.items()]
        for name, value in given:
            if name in hints and not _fits(value, hints[name]):
                raise UserError(name, shown(value), _expected(value, hints[name]))
            if name not in names and not takes_others:
                raise UserError(name, "unknown argument", f"one of: {', '.join(names)}")
        try:
            return function(*plain_args, **plain)
        except HcbenchError as error:
            name_parameters(error, names)
            raise
        except TypeError:
            # Of the call, if it does not fit the signature; else of the function itself.
            _require_bound(signature, args, kwargs, _hints(function))
            raise

    outer.__signature__ = signature  # type: ignore[attr-defined]  # which `help` and notebooks show
    return outer


def _require_bound(
    signature: inspect.Signature,
    args: tuple[Any, ...],
    kwargs: Mapping[str, Any],
    hints: Mapping[str, Any],
) -> None:
    """Raise a UserError that names the argument which a call lacks, or has too many of; return for
    a call that fits the signature.

    args, kwargs: of the call.
    hints: types of the parameters, by name, for the words of the error.
    """
    try:
        signature.bind(*args, **kwargs)
    except TypeError as error:
        for place, (name, parameter) in enumerate(signature.parameters.items()):
            is_needed = parameter.default is inspect.Parameter.empty
            if is_needed and place >= len(args) and name not in kwargs:
                expected = _words(hints[name]) if name in hints else "an argument"
                raise UserError(name, "missing", expected) from None
        raise UserError("arguments", str(error), str(signature)) from None


def name_parameters(error: HcbenchError, names: Collection[str]) -> None:
    """Change an error in place so that it names parameters of a function, not options of the
    command line; in a process that runs a command it stays as it is.

    names: of the parameters. Messages are written for the command line, which has an option for
    nearly every parameter; an option without a parameter, such as one of another program, stays.
    """
    if NAMES_OPTIONS.get():
        return

    def parameter(option: str) -> str:
        candidates = (option.replace("-", "_"), *_PARAMETERS.get(option, ()))
        for name in candidates:
            if name.partition("=")[0] in names:
                return name
        return ""

    def named(text: str) -> str:
        text = text.replace("--beyond-bounds", _BEYOND_BOUNDS)
        return _OPTION.sub(lambda match: parameter(match[1]) or match[0], text)

    slot = parameter(error.slot.removeprefix("--")) or error.slot
    HcbenchError.__init__(error, *map(named, (slot, error.got, error.expected, error.advice)))


def _spelled_out(function: Callable[..., Any]) -> inspect.Signature:
    """The signature of a function, with each option of `**options: Unpack[...]` as a keyword of its
    own, whose default is None.
    """
    signature = inspect.signature(function)
    parameters = list(signature.parameters.values())
    if not parameters or not str(parameters[-1].annotation).startswith("Unpack["):
        return signature
    options = get_args(eval(parameters.pop().annotation, function.__globals__))[0]
    keyword = inspect.Parameter.KEYWORD_ONLY
    names = get_type_hints(options)
    parameters += [inspect.Parameter(name, keyword, default=None) for name in names]
    return signature.replace(parameters=parameters)


def _plain(value: Any) -> Any:
    """Turn a NumPy number, or an array without dimensions, into a number of Python, which prints as
    one, and a caller's kind of text into text, which a worker process can read; also inside lists,
    tuples and dicts. Any other value is returned as it is.
    """
    if isinstance(value, str):
        return str.__str__(value)
    if isinstance(value, np.ndarray) and not value.ndim:
        value = value[()]
    # The item of a duration may be a whole number, without its unit.
    if isinstance(value, np.generic) and not isinstance(value, np.timedelta64 | np.datetime64):
        return value.item()
    if type(value) in (list, tuple):
        return type(value)(map(_plain, value))
    if type(value) is dict:
        return {key: _plain(each) for key, each in value.items()}
    return value


def checked_fields(cls: C) -> C:
    """The dataclass; fields of another type than annotated are a UserError in the field's name."""
    cls.__init__ = checked(cls.__init__)  # type: ignore[misc]
    return cls


@functools.cache
def _hints(function: Callable[..., Any]) -> dict[str, Any]:
    """Type of each parameter, by its name, and of each option of `Unpack[...]`; parameters whose
    types are imported for type checking only are left out, and so are not checked.
    """
    hints: dict[str, Any] = {}
    for name, annotation in function.__annotations__.items():
        if name != "return":
            with suppress(NameError):
                hint: Any = annotation
                if isinstance(annotation, str):
                    hint = eval(annotation, function.__globals__)
                origin: Any = get_origin(hint)
                if origin is Unpack:
                    hints |= get_type_hints(get_args(hint)[0])
                else:
                    hints[name] = hint
    return hints


def _fits(value: Any, hint: Any) -> bool:
    """Say whether a value fits an annotated type; a list serves for a tuple, any real number up to
    the largest float for a float. True also for a type that cannot be told apart at run time.

    An int fits up to _LARGEST_INT, of either sign.
    """
    # The usual case, answered at once. An int may still be too large.
    if type(value) is hint and hint is not int:
        return True
    # `list` of `list[int]`; None of a type without parts.
    origin = get_origin(hint)
    test = _TESTS.get(origin or hint)
    if test is None and isinstance(origin, type):
        test = next((test for kind, test in _GENERIC.items() if issubclass(origin, kind)), None)
    if test is not None:
        return test(value, get_args(hint))
    # `isinstance` takes no protocol but those marked `runtime_checkable`.
    is_told_apart = getattr(hint, "_is_runtime_protocol", not getattr(hint, "_is_protocol", False))
    is_class = origin is None and isinstance(hint, type) and is_told_apart
    return not is_class or hint is Any or isinstance(value, hint)


def _is_number(value: Any, _: _Parts) -> bool:
    if isinstance(value, float):
        return True
    return is_real(value) and (isinstance(value, np.generic) or abs(value) <= _LARGEST_FLOAT)


def _is_whole(value: Any, _: _Parts) -> bool:
    is_whole = is_real(value) and isinstance(value, int | np.integer)
    return is_whole and bool(abs(value) <= _LARGEST_INT)


def is_array(value: Any, _: _Parts = ()) -> bool:
    """Say whether NumPy makes an array of real numbers of a value."""
    # Solvers ask a million times, and to compare with a protocol takes ten times as long as a law.
    if isinstance(value, np.ndarray | np.generic):
        return value.dtype.kind in "iuf"
    if isinstance(value, PintQuantity):
        # NumPy would take its numbers and drop their unit.
        return False
    with suppress(ValueError, TypeError):
        return np.asarray(value).dtype.kind in "iuf"
    return False


def _is_tuple(value: Any, parts: _Parts) -> bool:
    """Say whether a value is a tuple or list of such parts, or of any number of one where `...` is
    the last.

    parts: types, as `tuple[...]` has them; none of `tuple[()]`, which an empty one alone fits.
    """
    if not isinstance(value, tuple | list):
        return False
    if parts[1:] == (Ellipsis,):
        parts = parts[:1] * len(value)
    return len(value) == len(parts) and all(map(_fits, value, parts))


def _is_several(value: Any, parts: _Parts) -> bool:
    """Say whether a value can be iterated and each of its items fits the first of the types; text
    and mappings are one value. An iterator is used up by this.
    """
    if isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable):
        return False
    try:
        each_value = iter(value)
    except TypeError:
        # One quantity of Pint's, or a tensor of one number, has the method and cannot be iterated.
        return False
    return all(_fits(each, parts[0]) for each in each_value)


def _is_sequence(value: Any, parts: _Parts) -> bool:
    # An open file and a generator are used up by the first look; a set has no order.
    has_places = hasattr(value, "__len__") and hasattr(value, "__getitem__")
    return has_places and _is_several(value, parts)


def _is_any_of(value: Any, parts: _Parts) -> bool:
    return any(_fits(value, part) for part in parts)


# Whether a value is of a type, by the type's parts.
_TESTS: dict[Any, Callable[[Any, _Parts], bool]] = {
    Union: _is_any_of,
    types.UnionType: _is_any_of,
    Literal: lambda value, parts: any(
        type(value) is type(part) and value == part for part in parts
    ),
    float: _is_number,
    int: _is_whole,
    None: lambda value, _: value is None,
    Callable: lambda value, _: callable(value),
    Annotated: lambda value, parts: _fits(value, parts[0]) and value >= parts[1].least,
}
# The first kind that the type belongs to decides, so the order matters.
_GENERIC: dict[type, Callable[[Any, _Parts], bool]] = {
    np.ndarray: is_array,
    tuple: _is_tuple,
    Mapping: lambda value, _: isinstance(value, Mapping),
    Sequence: _is_sequence,
    Iterable: _is_several,
}


def _expected(value: Any, hint: Any) -> str:
    """The words for what an error expected of a value that does not fit its annotated type."""
    words = _words(hint)
    is_too_large = isinstance(value, int) and abs(value) > _LARGEST_INT
    if is_too_large and int in (hint, *get_args(hint)):
        return f"{words}, up to {_LARGEST_INT}"
    return words


def _words(hint: Any) -> str:
    """Describe an annotated type in words, for what an error expected: "a number", "text, a path or
    a list of numbers".
    """
    origin = get_origin(hint)
    parts = get_args(hint)
    if origin in (Union, types.UnionType):
        # None says the same as an argument that is left out.
        given = [part for part in parts if part is not type(None)]
        known = _WORDS.get(functools.reduce(operator.or_, given))
        if known:
            return known
        *others, last = map(_words, given)
        if not others:
            return last
        return f"{', '.join(others)} or {last}"
    if origin is Annotated:
        return f"{_words(parts[0])}, {parts[1].least} or more"
    if origin is Literal:
        return " or ".join(map(repr, parts))
    if origin is np.ndarray:
        return "numbers"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "a mapping of names to values"
    if isinstance(origin, type) and issubclass(origin, Iterable):
        # list[X] and tuple[X, ...] have any number of items, tuple[X, Y] as many as it names.
        if parts and parts[1:] in ((), (Ellipsis,)):
            return f"a list, each item {_words(parts[0])}"
        return f"{len(parts)} values"
    return _WORDS.get(hint, f"a {getattr(hint, '__name__', hint)}")
