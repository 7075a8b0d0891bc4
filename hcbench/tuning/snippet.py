"""A setting as its user writes it: what to paste into a model or a script."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from hcbench._text import shortest
from hcbench.sim import registry

if TYPE_CHECKING:
    from collections.abc import Mapping

    from hcbench.setting import Setting


def snippet(setting: Setting, form: str) -> str:
    """What to paste of a setting; "" where nothing is set. Options of an engine not known here as JSON.

    form: the scene's, "plane" or "cup".
    """
    if registry.base_name(setting.engine) not in registry.names():
        return setting.options_text
    return registry.engine(setting.engine).snippet(setting, form)


def arguments(values: Mapping[str, Any]) -> str:
    """Keyword arguments of a call."""
    return ", ".join(f"{k}={shortest(v) if isinstance(v, float) else repr(v)}" for k, v in values.items())
