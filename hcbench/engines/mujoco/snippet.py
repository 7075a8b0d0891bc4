"""A MuJoCo setting as its user writes it: MJCF."""

from hcbench.engines.mujoco.mjcf import rows_snippet
from hcbench.setting import Setting


def snippet(setting: Setting, form: str, radius: float) -> str:
    """What to paste; see `Engine.snippet`."""
    if "law" in setting.options:
        from hcbench.engines.mujoco.law_mjcf import law_snippet  # imports SciPy, as the laws do
        from hcbench.laws.contact_law import law_of

        return law_snippet(law_of(setting.options["law"]), form)
    return rows_snippet(setting, form, radius) if setting.options.get("rows") else setting.options_text
