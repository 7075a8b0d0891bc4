"""One contact as Drake writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words


def words(contact: OneContact) -> Words:
    """Its dissipation."""
    note, name = "d = 1.5 α, on both bodies; continuous plants only", "hunt_crossley_dissipation"
    value = SystemValue("Drake", name, (1.5 * contact.alpha,), "s/m", note)
    return Words(
        (value,),
        traps=(
            "Drake's d is 1.5 α, Simbody's c is α: the number copied from one to the other is off by half.",
            "Simbody raises x to 3/2, Drake to 1; e is the same: it depends on α v, not on k or n.",
            "Drake's discrete plant multiplies e by exp(-π ω h/2), ω² = k/m; `sap` ignores d.",
        ),
    )
