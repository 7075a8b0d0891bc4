"""A setting as its user writes it: what to paste into a model or a script."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.sim import registry

if TYPE_CHECKING:
    from hcbench.setting import Setting


def snippet(setting: Setting, form: str) -> str:
    """What to paste of a setting; "" where nothing is set. Options of an engine not known here as JSON.

    form: the scene's, "plane" or "cup".
    """
    if registry.base_name(setting.engine) not in registry.names():
        return setting.options_text
    return registry.engine(setting.engine).snippet(setting, form)
