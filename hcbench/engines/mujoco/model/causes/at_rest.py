"""Causes of a pair that lies deep, or does not lie still."""

from collections.abc import Iterator
from functools import partial

from hcbench.engines.mujoco.model.causes import fixes
from hcbench.engines.mujoco.model.causes.context import Context
from hcbench.sim.model_under_test import Suspect
from hcbench.system.text import time_step

# A contact gives way to a weight by its 1 - d: a fix leaves this share of it.
_HARDER = 0.1
# Share of the step that a fix leaves.
_FINER = 0.25


def at_rest(context: Context) -> Iterator[Suspect]:
    """A contact that yields to a weight, and a step that is too long for it."""
    if (law := context.used) is not None:
        low, high, *curve = law.solimp
        harder = [float(f"{1.0 - _HARDER * (1.0 - d):.6g}") for d in (low, high)]
        solimp = (*harder, *curve)
        yield Suspect(
            "soft-contact",
            "The contact yields to a weight: the bodies lie deep.",
            f"solref {fixes.numbers(law.solref)}, solimp {fixes.numbers(law.solimp)}",
            f'{context.names}: solimp="{fixes.numbers(solimp)}"',
            partial(fixes.set_contact, geoms=context.all_geoms, solref=None, solimp=solimp),
        )
    finer = _FINER * context.timestep
    yield Suspect(
        "long-step",
        "The step is too long for the contact to come to rest.",
        f"a step of {time_step(context.timestep)} s",
        f'<option timestep="{finer:.6g}"/>',
        partial(fixes.set_options, timestep=finer),
    )
