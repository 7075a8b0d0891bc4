"""What an engine says of its own contact, for the table of features in `hcbench report field`.

An engine that says it has a module `features` in its package (`registry.submodule`) with `FEATURES`.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Feature:
    """What it is, and where that is from: a page, a source file, or how it was measured."""

    text: str
    source: str


@dataclass(frozen=True, slots=True)
class Features:
    """Of an engine's own contact, with nothing added.

    law: its force or impulse. exponent: of the penetration in it. threshold: below which speed it does not
    bounce, and what sets that. licence: of the package.
    """

    law: Feature
    exponent: Feature
    threshold: Feature
    licence: Feature
