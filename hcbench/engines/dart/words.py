"""One contact as DART writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAPS = (
    "DART bounces nothing while e v is below 0.1 units of length a second: model a band of low speeds in cm.",
    "DART multiplies the restitutions of both shapes; stock is 0, so the plate needs 1.",
)


def words(contact: OneContact) -> Words:
    """Its restitution, with what constraint force mixing of 1e-5 takes added."""
    e = contact.restitution
    if e is None:
        return Words(traps=_TRAPS)
    note = f"{contact.at}; setRestitutionCoeff on one shape, 1 on the other"
    value = min(1.0, (1.0 + e) * (1.0 + 1e-5) - 1.0)
    return Words((SystemValue("DART", "restitution", (value,), "", note),), traps=_TRAPS)
