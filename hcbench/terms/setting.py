"""A setting: what a user can set in an engine, as plain data that can be hashed, stored and pasted."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from hcbench.terms.arguments import checked_fields

Pair = tuple[str, str]
# The body that moves and the other, as texts to paste name them.
PAIR: Pair = ("ball", "plate")


@checked_fields
@dataclass(frozen=True)
class Setting:
    """One way to set an engine up.

    engine: the engine's registered name.
    name: the recipe that made it, such as "impulse".
    timestep: s.
    options: the engine's own words with JSON values; the adapter validates them. Empty means: as
    authored.
    """

    engine: str
    name: str
    timestep: float
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def options_text(self) -> str:
        """The options as JSON to read; "" where nothing is set."""
        return json.dumps(self.options, indent=1, ensure_ascii=False) if self.options else ""

    @property
    def key(self) -> str:
        """Text that is equal for equal settings, for any order of their options."""
        return json.dumps([self.engine, self.name, self.timestep, self.options], sort_keys=True)
