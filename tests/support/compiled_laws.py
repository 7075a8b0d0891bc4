"""The compiled laws of `hcbench/laws/*.c`, as functions."""

from ctypes import Structure, byref, c_double
from dataclasses import dataclass

from hcbench.laws import closed_form
from hcbench.system import compiler as _compile


@dataclass(frozen=True)
class ContactOde:
    """`hcb_law`: x'' = b - kappa x^n (1 + a x'); of a law with chi, a is that of each impact."""

    kappa: float
    a: float
    n: float
    b: float = 0.0
    chi: float = 0.0
    e: float = 1.0
    load: float = 0.0
    speed_min: float = 1e-9

    def acceleration(self, x: float, v: float) -> float:
        """x'' in m/s²."""
        return float(self.b - self.kappa * max(x, 0.0) ** self.n * max(1 + self.a * v, 0.0))


def touch_speed_ode(kappa: float, chi: float, n: float, b: float = 0.0) -> ContactOde:
    """The motion under a law with chi > 0 whose v_i is the touch speed
    of each impact; b is constant.
    """
    return ContactOde(kappa, 0.0, n, b, chi, float(closed_form.restitution(chi / 1.5, 1.0)), b)


class _Law(Structure):
    _fields_ = [(name, c_double) for name in ContactOde.__dataclass_fields__]


def _in_c(ode: ContactOde) -> _Law:
    return _Law(*(getattr(ode, name) for name in ContactOde.__dataclass_fields__))


def _call(name: str, *values: float) -> float:
    function = getattr(_compile.law_library(), name)
    function.restype = c_double
    return float(function(*map(c_double, values)))


def touch_speed(
    kappa: float, n: float, chi: float, e: float, load: float, x: float, v: float
) -> float:
    """The speed at which an impact began."""
    return _call("hcb_touch_speed", kappa, n, chi, e, load, x, v)


def restitution(d: float) -> float:
    """E of eq. (16) at d = (3/2) α v."""
    return _call("hcb_restitution", d)


def advance(ode: ContactOde, time: float, x: float, v: float) -> tuple[float, float]:
    """The motion after a time."""
    at, rate = c_double(x), c_double(v)
    _compile.law_library().hcb_advance(byref(_in_c(ode)), c_double(time), byref(at), byref(rate))
    return at.value, rate.value


def euler_force(ode: ContactOde, h: float, x: float, v: float) -> float:
    """F/m for a step of semi-implicit Euler."""
    function = _compile.law_library().hcb_euler_force
    function.restype = c_double
    return float(function(byref(_in_c(ode)), c_double(h), c_double(x), c_double(v), None))


def rk4_stage_forces(ode: ContactOde, h: float, x: float, v: float) -> tuple[float, float, float]:
    """F/m of the first, the two middle and the last stage of RK4."""
    stages = (c_double * 3)()
    _compile.law_library().hcb_rk4_stage_forces(
        byref(_in_c(ode)), c_double(h), c_double(x), c_double(v), stages
    )
    return stages[0], stages[1], stages[2]
