"""A MuJoCo setting as its user writes it: MJCF, or the lines that attach a plug-in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from hcbench.engines.mujoco.mjcf import rows_snippet
from hcbench.tune.snippet import law_expression

if TYPE_CHECKING:
    from hcbench.setting import Setting


def snippet(setting: Setting, form: str, radius: float) -> str:
    """What to paste; see `Engine.snippet`."""
    if "law" in setting.options:
        law, line = law_expression(setting.options["law"])
        where = f'law={law}, tendons=["contact"]' if form == "cup" else f'[("ball", "plate")], {law}'
        return f"from hcbench.contact import mujoco as contact\n{line}\nlaw = contact.attach(model, {where})"
    return rows_snippet(setting, form, radius) if setting.options.get("rows") else setting.options_text
