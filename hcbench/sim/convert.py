"""One contact in every library's words: those of the paper, and those of each engine from its own folder."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench.laws.conventions import contact_of, said
from hcbench.sim import registry
from hcbench.sim.capabilities import DescribesContact

if TYPE_CHECKING:
    from hcbench.laws.conventions import Conversion


def convert(**given: Any) -> Conversion:
    """Say one contact in every convention. given: as `hcbench.laws.conventions.contact_of` takes it."""
    contact = contact_of(**given)
    engines = map(registry.adapter, registry.names())
    own = (engine.vocabulary(contact) for engine in engines if isinstance(engine, DescribesContact))
    return said(contact, own)
