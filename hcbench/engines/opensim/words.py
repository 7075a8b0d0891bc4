"""One contact as OpenSim writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words

_TRAP = "OpenSim's HuntCrossleyForce is the law; its stock accuracy, 1e-3, errs by .2 in e or gains energy."


def words(contact: OneContact) -> Words:
    """Its dissipation."""
    note = "c = α, of HuntCrossleyForce; with an accuracy of 1e-9 or less"
    return Words((SystemValue("OpenSim", "dissipation", (contact.alpha,), "s/m", note),), traps=(_TRAP,))
