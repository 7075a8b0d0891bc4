"""One contact as MJX writes it, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = ("MJX drops a pair's adhesion; in float32 it wants solimp .9 where MuJoCo takes .9999.",)


def words(contact: OneContact) -> Words:
    """Its solref for a bounce in one step."""
    if contact.restitution is None or contact.timestep is None:
        return Words(traps=_TRAPS)
    solref = (0.0, -(1.0 + contact.restitution) / contact.timestep)
    note = "bounces in one step; solimp .9 .9 .001 in float32"
    return Words((SystemValue("MJX", "solref", solref, "", note),), traps=_TRAPS)
