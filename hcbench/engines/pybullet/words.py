"""One contact as PyBullet writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAP = "PyBullet multiplies the restitutions of both bodies; its velocity threshold, slop and ERP must be 0."


def words(contact: OneContact) -> Words:
    """Its restitution."""
    if contact.restitution is None:
        return Words(traps=(_TRAP,))
    note = f"{contact.at}; on one body, 1 on the other"
    return Words((SystemValue("PyBullet", "restitution", (contact.restitution,), "", note),), traps=(_TRAP,))
