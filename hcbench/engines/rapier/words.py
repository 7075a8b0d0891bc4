"""One contact as Rapier writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words


def words(contact: OneContact) -> Words:
    """Its restitution."""
    if contact.restitution is None:
        return Words()
    note = f"{contact.at}; on both colliders, whose average it uses"
    return Words((SystemValue("Rapier", "restitution", (contact.restitution,), "", note),))
