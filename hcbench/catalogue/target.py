"""The material that a target is given by, for verbs that take it beside α and e."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.system.errors import UserError
from hcbench.terms.options import MaterialName

if TYPE_CHECKING:
    from hcbench.catalogue.material import MaterialPair


def target_material(name: MaterialName | None, **others: object) -> MaterialPair | None:
    """The material that a target is given by; None without a name.

    others: other ways to give a target, by the names of their options; None for one that is not
    given.
    Raises UserError for one that is given too, and for a name or file as `find`.
    """
    if name is None:
        return None
    given = [option for option, value in others.items() if value is not None]
    if given:
        names = " and ".join(("--material", *(f"--{option}" for option in given)))
        raise UserError("target", f"{names} are given", "one target")
    # Imported here: most calls name no material, and Pydantic takes long to import.
    from hcbench.catalogue.find import find

    return find(name)
