"""Finds the parts of a model that a user names, and suggests the nearest name for one that is not there."""

import difflib
from collections.abc import Iterable, Sequence
from typing import TypeVar

from hcbench.system.errors import UserError

Id = TypeVar("Id")

_LISTED = 12  # names that an error shows


def find_part(parts: Sequence[tuple[str, str, Id]], request: str) -> tuple[str, Id]:
    """(kind, id) of the part that a user names.

    parts: (kind, name, id) of each, such as ("geom", "plate", 0). Of several with the same name the first is
        meant.
    request: a name, or "KIND:NAME" or "KIND:ID" to say which.
    Raises UserError with the names there are.
    """
    by_id = {f"{kind}:{key}": (kind, key) for kind, _, key in parts}
    by_kind = {f"{kind}:{name}": (kind, key) for kind, name, key in reversed(parts)}
    by_name = {name: (kind, key) for kind, name, key in reversed(parts)}
    try:
        return (by_id | by_kind | by_name)[request]
    except KeyError:
        kinds = " or ".join(dict.fromkeys(kind for kind, _, _ in parts))
        expected, advice = suggest_names(request, (name for _, name, _ in parts))
        raise UserError("pair", f"no {kinds} {request!r}", expected, advice) from None


def suggest_names(request: str, names: Iterable[str]) -> tuple[str, str]:
    """For a name that is not among `names`: (the names expected, a sentence with the nearest one),
    for an error.
    """
    known = list(dict.fromkeys(filter(None, names)))
    listed = known if len(known) <= _LISTED else [*known[:_LISTED], "..."]
    nearest = difflib.get_close_matches(request, known, 1)
    return f"one of: {', '.join(listed) or 'none has a name'}", (
        f"Did you mean {nearest[0]!r}?" if nearest else ""
    )
