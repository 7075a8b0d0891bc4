"""Densities that no body has, as signs of a model in other units than metres and kilograms."""

from __future__ import annotations

# Density, kg/m³, over the boxes about each of a body's shapes. Lead has ten times less in a model in
# centimetres; of 1 720 bodies in three engines' packages none is below 0.4.
_LIGHTEST = 0.1
# The same over the box around all of a body with its frames; none of those bodies is above 4e4.
_HEAVIEST = 2e5
# Densities of robots and things, kg/m³: foam to lead.
_USUAL = (20.0, 2e4)


def unit_notes(name: str, mass: float, shapes: float, around: float) -> list[str]:
    """A sentence on a body whose density says that the model is in other units; empty where it is
    plausible, or where the body has no mass or no size.

    name: of the body. mass: of all that hangs on it, kg. shapes: volume of the boxes about each of
    its shapes, m³; around: of the box about all of them and their frames, m³.
    """
    if not (mass > 0.0 and shapes > 0.0 and around > 0.0):
        return []
    light = mass / shapes
    heavy = mass / around
    if light < _LIGHTEST:
        units = "millimetres"
        if _is_usual(1e6 * light):
            units = "centimetres, or in millimetres and grams"
        return [_sentence(name, light, units)]
    if heavy > _HEAVIEST:
        return [_sentence(name, heavy, "grams")]
    return []


def _is_usual(density: float) -> bool:
    low, high = _USUAL
    return low <= density <= high


def _sentence(name: str, density: float, units: str) -> str:
    return (
        f"{name} weighs {density:.2g} kg/m^3: is the model in {units}? hcbench reads metres, "
        "kilograms and seconds."
    )
