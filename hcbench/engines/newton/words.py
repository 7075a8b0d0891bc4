"""One contact as Newton writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words


def words(contact: OneContact) -> Words:
    """Its restitution."""
    e, note = contact.restitution, "on both shapes, with enable_restitution"
    rows = (SystemValue("Newton", "restitution", (e,), "", f"{contact.at}; {note}"),) if e else ()
    return Words(rows, traps=("Newton's SolverXPBD needs enable_restitution, and averages both e.",))
