"""One contact in every library's words: those of the paper, and those of each engine from its own folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.laws.conventions import contact_of, said
from hcbench.sim import registry

if TYPE_CHECKING:
    from hcbench.laws.conventions import Conversion


def convert(**given: Any) -> Conversion:
    """Say one contact in every convention. given: as `hcbench.laws.conventions.contact_of` takes it."""
    contact = contact_of(**given)
    return said(contact, [registry.engine(name).words(contact) for name in registry.names()])
