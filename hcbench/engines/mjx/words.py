"""One contact as MJX writes it, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = ("MJX drops a pair's adhesion; in float32 it wants solimp .9 where MuJoCo takes .9999.",)


def words(contact: OneContact) -> Words:
    """Its solref for a bounce in one step."""
    e, h, note = contact.restitution, contact.timestep, "bounces in one step; solimp .9 .9 .001 in float32"
    rows = (SystemValue("MJX", "solref", (0.0, -(1.0 + e) / h), "", note),) if e and h else ()
    return Words(rows, traps=_TRAPS)
