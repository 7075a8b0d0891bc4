"""One contact as Exudyn writes it, for `hcbench convert`."""

from hcbench.laws.conventions import OneContact, SystemValue, Words


def words(contact: OneContact) -> Words:
    """e and V of impactModel 1, the law at all speeds up to V: here the one given."""
    v, alpha = contact.speed, contact.alpha
    if v is None or alpha * v >= 1.0:
        return Words()
    note = f"impactModel 1: eq. (16) up to {v:.6g} m/s, with the law's contactStiffness and its exponent"
    name = "restitutionCoefficient, minimumImpactVelocity"
    return Words((SystemValue("Exudyn", name, (1.0 - alpha * v, v), "1, m/s", note),))
