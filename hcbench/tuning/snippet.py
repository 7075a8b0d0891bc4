"""A setting as its user writes it: what to paste into a model or a script."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.sim import registry

if TYPE_CHECKING:
    from hcbench.terms.setting import Setting


def snippet(setting: Setting, form: str) -> str:
    """Return the text of a setting to paste; "" if nothing is set. Options of an unknown engine
    come as JSON.

    form: the scene's, "plane" or "cup".
    """
    if registry.base_name(setting.engine) not in registry.names():
        return setting.options_text
    return registry.engine(setting.engine).snippet(setting, form)
