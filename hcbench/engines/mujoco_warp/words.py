"""One contact as MuJoCo Warp writes it, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = ("MuJoCo Warp keeps one of several pairs of the same two geoms; solimp powers above 100 underflow.",)


def words(contact: OneContact) -> Words:
    """Its solref for a bounce in one step."""
    e, h, note = contact.restitution, contact.timestep, "bounces in one step; solimp .9999 .9999 .001"
    rows = (SystemValue("MuJoCo Warp", "solref", (0.0, -(1.0 + e) / h), "", note),) if e and h else ()
    return Words(rows, traps=_TRAPS)
