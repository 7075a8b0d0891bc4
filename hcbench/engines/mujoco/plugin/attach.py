"""Hunt-Crossley contact for a MuJoCo simulation of your own.

    from hcbench.contact import mujoco as contact
    from hcbench.reference.laws import HuntCrossley

    with contact.attach(model, [("ball", "plate")], HuntCrossley(stiffness=3.4e10, alpha=0.315)):
        mujoco.mj_step(model, data)

The law takes the attached pairs over, at MuJoCo's own contact points and normals, and leaves every other
contact alone. `HuntCrossley` is the force law for steps that resolve the contact; `Restitution(alpha)` gives
each impact e(v) of its own approach speed in the step that it happens in, for steps that do not. Of the laws
that came after, `TouchSpeedLaw(Flores, k, e)` is the force and `ConstantRestitution(Flores.delivered(e))`
what it does to a speed.

How. MuJoCo calls mjcb_contactfilter and mjcb_passive: the first keeps attached pairs out of MuJoCo's contact,
the second adds the force that laws/exact_step.py works out to qfrc_passive. Of a pair with a restitution law
MuJoCo's own contact stays, and the second callback gives its constraint rows the acceleration that ends the
step at e(v). Both are compiled C where a compiler is found, so that `mujoco.rollout` and `mujoco.batch.Batch`
run them on all threads; else Python takes over, with a warning (MuJoCo then compiles no other model until you
detach, as with any callback in Python). Callbacks that you have installed before are called too. Install
yours before you attach, not after: MuJoCo has room for one.

While attached, a model has changed in these inert places: opt.o_margin, o_solref, o_solimp and o_friction
(MuJoCo reads them only under the override flag, which is refused), the margin of a <pair> that is attached
and the limited flag of a tendon whose limit is. Copies of the model carry the law along until it is detached.

Integrators. Euler, implicitfast, implicit: e of (16) to 1e-9 at h = 1e-6 s, to 1e-6 at 1e-5 s and above.
RK4: the same to 5e-6, its four stages share one plan. discrete: the force law as under Euler; Restitution is
refused. Contacts that share a body see each other to first order in their forces: then e is of second order,
1e-6 and 1e-4 at these steps. Restitution is exact to rounding; of several contacts at once to 1e-9, and to
1e-6 under implicit integrators, which feel the constraint forces' own rounding.

`TouchSpeedLaw` works v_i out from the state: resets, copies and threads need no care. e to 1e-7 at 1e-6 s, to
1e-5 at 1e-5 s; laws/touch_speed.py says what loads on a contact do to that.

Tested with mujoco 3.3.0, 3.6.0, 3.11.0 and 4.0.0 on Linux x86-64.
"""

from __future__ import annotations

import copy
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from hcbench.engines.mujoco.plugin import install as installed
from hcbench.engines.mujoco.plugin.pairs import (
    ContactAccuracyWarning,
    alpha_of,
    check_step,
    hertz_stiffness,
    named,
    pairs_between,
    pairs_of,
    resolve,
    spec,
    warn_of_shapes,
)
from hcbench.errors import CannotRun, EngineFailed, SettingError
from hcbench.laws.contact_law import Friction, Law, coarse, is_force, require_law
from hcbench.laws.force import HuntCrossley
from hcbench.laws.published import TouchSpeedLaw
from hcbench.laws.restitution import ConstantRestitution, Restitution

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from types import TracebackType

    from numpy.typing import ArrayLike

    from hcbench.impact import Floats

    Values = ArrayLike | None

__all__ = [
    "ConstantRestitution",
    "Contact",
    "ContactAccuracyWarning",
    "Friction",
    "HuntCrossley",
    "PythonContactWarning",
    "Restitution",
    "Touch",
    "TouchSpeedLaw",
    "attach",
    "hertz_stiffness",
    "pairs_between",
    "pairs_of",
]

PythonContactWarning = installed.PythonContactWarning
_SPEED = 0.508  # m/s: 20 in/s, up to where the paper's law holds
# Where a law's factor on k and its α are, so that copies of a model can differ in them.
_SLOTS = (("o_solref", 0), ("o_solimp", 0), ("o_solimp", 2), ("o_friction", 0), ("o_friction", 2))


@dataclass(frozen=True, slots=True)
class Touch:
    """One contact of the force law: SI, x > 0 in contact, force on the second geom along the normal."""

    pair: tuple[str | int, str | int]
    penetration: float
    rate: float
    force: float
    effective_mass: float
    point: Floats
    normal: Floats


class Contact:
    """A law attached to pairs of a model, until `detach` or the end of a `with` block."""

    def __init__(
        self, model: Any, law: Law, entry: installed.Entry, keys: Sequence[tuple[int, int, int, int]]
    ) -> None:
        self.model, self.law, self.keys = model, law, tuple(keys)
        self._entry = entry
        self._attached = True

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        trouble = self._trouble() if self._attached else None
        self.detach()
        if trouble is not None and kind is None:
            raise trouble

    @property
    def compiled(self) -> bool:
        """Whether compiled callbacks do the work; else Python does, and `Batch` refuses it."""
        return self._entry.compiled

    def detach(self) -> None:
        """Give the pairs back to MuJoCo, and the model every bit as it was. Twice is no harm."""
        if self._attached:
            self._attached = False
            installed.remove(self._entry, self.keys)

    def check(self) -> None:
        """Raise EngineFailed if the law met a state that is not finite or a step too coarse for it."""
        trouble = self._trouble()
        if trouble is not None:
            raise trouble

    def _trouble(self) -> EngineFailed | None:
        not_finite, too_coarse = self._entry.counters()
        where = " and ".join(named(self.model, key) for key in self.keys[:3])
        if not installed.active():
            return EngineFailed(
                "mjcb_passive",
                "replaced by another callback: the law no longer acts",
                "callbacks installed before attach",
                "They are chained",
            )
        if not_finite:
            return EngineFailed(
                f"contact {where}",
                f"{not_finite} times a position or speed that is not finite",
                "a state that the model can be in",
                "Look at the step, or at what else acts on the bodies",
            )
        if too_coarse:
            return EngineFailed(
                f"contact {where}",
                f"{too_coarse} times a penetration too fast for the step",
                f"a step well below {self.model.opt.timestep:g} s",
                f"Or attach {coarse(self.law)}, which needs no resolved contact",
            )
        return None

    def touches(self, data: Any) -> list[Touch]:
        """Contacts of the force law at the present state (after mj_step, call mj_forward first).

        Also those that will touch within the step that comes next, with penetration below 0.
        """
        keys = set(self.keys)
        return [
            Touch(tuple(self.model.geom(g).name or g for g in key[:2]), *rest)
            for key, *rest in self._entry.report(self.model, data)
            if key in keys
        ]

    def models(
        self, *, stiffness: Values = None, alpha: Values = None, restitution: Values = None
    ) -> list[Any]:
        """Copies of the model for `mujoco.rollout`, one for each k and α; they broadcast.

        stiffness: k, N/m^n. alpha: α, s/m. restitution: instead, where the law is one that is asked for it.
        """
        values = self._values(stiffness, alpha, restitution)
        made = []
        for row in values:
            one = copy.copy(self.model)
            field, start = self._slot()
            getattr(one.opt, field)[start : start + 2] = row
            made.append(one)
        return made

    def vary(
        self, batch: Any, *, stiffness: Values = None, alpha: Values = None, restitution: Values = None
    ) -> None:
        """Give each simulation of a `mujoco.batch.Batch` its own values of what `models` takes.

        The batch must have been made of the model while this law was attached.
        """
        field, start = self._slot()
        if batch.get_model(0).opt.o_margin != self.model.opt.o_margin:
            raise SettingError("batch", "made before the law was attached", "Batch(model, ...) made after it")
        values = np.broadcast_to(self._values(stiffness, alpha, restitution), (batch.nsim, 2))
        batch.expand(f"opt.{field}")[:, start : start + 2] = values

    def _slot(self) -> tuple[str, int]:
        slot = self._entry.slot_of(self.keys[0])
        if slot < 0:
            raise SettingError(
                "law",
                "the sixth or later of this model",
                f"one of the first {len(_SLOTS)}: only they can vary",
            )
        return _SLOTS[slot]

    def _values(self, stiffness: Values, alpha: Values, restitution: Values) -> Floats:
        own = self.law.stiffness if is_force(self.law) else 1.0
        if stiffness is not None and not is_force(self.law):
            raise SettingError("stiffness", "given for a restitution law", "alpha or restitution only")
        asked = isinstance(self.law, (TouchSpeedLaw, ConstantRestitution))
        if (alpha if asked else restitution) is not None:
            slot, other = ("alpha", "restitution") if asked else ("restitution", "alpha")
            raise SettingError(slot, f"given for {self.law!r}", other)
        factor = np.ones(1) if stiffness is None else np.asarray(stiffness, dtype=np.float64) / own
        given = np.full(1, alpha_of(self.law)) if alpha is None else np.asarray(alpha, dtype=np.float64)
        if restitution is not None:
            e = np.asarray(restitution, dtype=np.float64)
            given = self.law.family.chi_of(e) / 1.5 if isinstance(self.law, TouchSpeedLaw) else e
        for slot, values in (("stiffness", factor), ("restitution" if asked else "alpha", given)):
            if not np.isfinite(values).all() or (values < 0).any():
                raise SettingError(slot, f"{values.tolist()!r}", "finite numbers of 0 or more")
        return np.stack(np.broadcast_arrays(np.atleast_1d(factor), np.atleast_1d(given)), axis=-1)


def attach(
    model: Any,
    pairs: Iterable[Sequence[str | int]] = (),
    law: Law | None = None,
    *,
    tendons: Iterable[str | int] = (),
    friction: Friction | None = None,
    speed: float = _SPEED,
    compiled: bool | None = None,
) -> Contact:
    """Let `law` act on pairs of geoms of `model`, instead of MuJoCo's own contact.

    pairs: (geom, geom) by name or id; `pairs_between` and `pairs_of` make them from bodies.
    law: HuntCrossley or TouchSpeedLaw; Restitution or ConstantRestitution. friction: of a force law; a
    restitution law keeps MuJoCo's.
    tendons: tendons whose upper limit is a contact, as between the centres of a ball and of its cup.
    speed: largest approach speed expected, m/s: a step too coarse for it is refused.
    compiled: True insists on compiled callbacks (CannotRun without), False on Python, None takes the best.

    Raises SettingError for what cannot be attached; the model is untouched then.
    """
    if law is None:
        raise SettingError("law", "missing", "such as HuntCrossley(stiffness, alpha)")
    require_law(law)
    pairs = list(pairs)
    if len(pairs) == 2 and all(isinstance(geom, (str, int)) for geom in pairs):
        pairs = [pairs]  # type: ignore[list-item]  # one pair, given bare
    _check_options(model, law, friction)
    keys = resolve(model, pairs, tendons)
    check_step(model, law, keys, speed)
    warn_of_shapes(model, keys)
    entry = installed.entry_for(model, _backend(compiled))
    slot = entry.free_slot(len(_SLOTS))
    entry.refuse_twice(keys)
    installed.add(entry, [spec(law, friction, slot, key) for key in keys], _SLOTS)
    return Contact(model, law, entry, keys)


def _backend(compiled: bool | None) -> bool:
    reason = installed.why_not_compiled()
    if reason is None or compiled is False:
        return compiled is not False
    if compiled:
        raise CannotRun("compiled contact", reason, "a C compiler, such as cc, or the package ziglang")
    warnings.warn(
        f"contact runs in Python, some ten times slower, and mujoco.batch refuses it: {reason}",
        PythonContactWarning,
        stacklevel=3,
    )
    return False


def _check_options(model: Any, law: Law, friction: Friction | None) -> None:
    import mujoco

    flags, integrator = int(model.opt.disableflags), int(model.opt.integrator)
    off = [getattr(mujoco.mjtDisableBit, name, None) for name in ("mjDSBL_SPRING", "mjDSBL_DAMPER")]
    if off[0] is None:
        off = [mujoco.mjtDisableBit.mjDSBL_PASSIVE]
    if all(flags & int(bit) for bit in off if bit is not None):
        raise SettingError(
            "model", "its passive forces are disabled", "them enabled", "The law is one of them"
        )
    enabled = int(model.opt.enableflags)
    for name, why in (
        ("OVERRIDE", "it replaces the parameters of all contacts"),
        ("SLEEP", "the law does not wake bodies"),
    ):
        bit = getattr(mujoco.mjtEnableBit, f"mjENBL_{name}", None)
        if bit is not None and enabled & int(bit):
            raise SettingError(f"model flag {name.lower()!r}", "enabled", "it disabled", why.capitalize())
    if is_force(law):
        return
    if friction is not None:
        raise SettingError("friction", "given for a restitution law", "none", "MuJoCo's own friction stays")
    if integrator == int(getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", -1)):
        raise SettingError(
            "integrator 'discrete'", "given for a restitution law", "Euler, implicitfast or RK4"
        )
    if int(model.opt.solver) == int(mujoco.mjtSolver.mjSOL_PGS):
        raise SettingError("solver 'PGS'", "given for a restitution law", "Newton or CG")
