"""One contact as MuJoCo Warp writes it, for `hcbench convert`."""

from __future__ import annotations

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = ("MuJoCo Warp keeps one of several pairs of the same two geoms; solimp powers above 100 underflow.",)


def words(contact: OneContact) -> Words:
    """Its solref for a bounce in one step."""
    if contact.restitution is None or contact.timestep is None:
        return Words(traps=_TRAPS)
    solref = (0.0, -(1.0 + contact.restitution) / contact.timestep)
    note = "bounces in one step; solimp .9999 .9999 .001"
    return Words((SystemValue("MuJoCo Warp", "solref", solref, "", note),), traps=_TRAPS)
