"""The rule for simultaneous impacts, `laws/impacts.c`: any system, no engine."""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import pytest

from hcbench.laws.closed_form import restitution
from hcbench.system import compiler as _compile

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.terms.impact import Floats

    Problem = tuple[Floats, Floats, Floats, list["Contact"]]

LAW, LINEAR, CONSTANT = 0, 1, 2
DOUBLES = ctypes.POINTER(ctypes.c_double)


class Contact(ctypes.Structure):
    _fields_ = [
        ("kind", ctypes.c_int),
        *((name, ctypes.c_double) for name in ("value", "friction", "still", "lift", "lag")),
    ]


class Rows(ctypes.Structure):
    _fields_ = [("part", ctypes.c_int * 2), ("J", DOUBLES * 2), ("B", DOUBLES * 2)]


class System(ctypes.Structure):
    _fields_ = [
        ("n", ctypes.c_int),
        ("parts", ctypes.c_int),
        ("at", ctypes.POINTER(ctypes.c_int)),
        ("rows", ctypes.POINTER(Rows)),
        ("contacts", ctypes.POINTER(Contact)),
    ]


@dataclass
class After:
    u: Floats
    p: Floats
    v: Floats
    rounds: int


def collide(M: Floats, J: Floats, v: Floats, contacts: Sequence[Contact]) -> After:
    """Velocities after the impacts of `contacts`, whose rows of J are normal, tangent, tangent."""
    lib = _compile.law_library()
    lib.hcb_impacts_work.restype = ctypes.c_size_t
    n, nv = len(contacts), len(v)
    # A body a velocity where contacts are between two of them, else one part with all velocities.
    most = np.count_nonzero(J.reshape(n, 3, nv).any(axis=1), axis=1).max()
    apart = np.count_nonzero(M) == nv and most <= 2
    at = np.arange(nv + 1, dtype=np.intc) if apart else np.array([0, nv], dtype=np.intc)
    B, p, u = np.linalg.solve(M, J.T).T, np.zeros(3 * n), J @ v
    kept: list[Floats] = []
    rows = (Rows * n)()
    for i in range(n):
        own = J[3 * i : 3 * i + 3]
        touched = [int(q) for q in np.flatnonzero(own.any(axis=0))] if apart else [0]
        rows[i].part[:] = [*touched, -1, -1][:2]
        for side, part in enumerate(touched):
            columns = slice(int(at[part]), int(at[part + 1]))
            pair = [np.ascontiguousarray(full[3 * i : 3 * i + 3, columns]) for full in (J, B)]
            rows[i].J[side], rows[i].B[side] = (one.ctypes.data_as(DOUBLES) for one in pair)
            kept += pair
    laws = (Contact * n)(*contacts)
    system = System(n, len(at) - 1, at.ctypes.data_as(ctypes.POINTER(ctypes.c_int)), rows, laws)
    work = np.full(lib.hcb_impacts_work(n, len(at) - 1, nv), np.nan)
    ptr = [a.ctypes.data_as(DOUBLES) for a in (u, p, work)]
    rounds = lib.hcb_impacts(ctypes.byref(system), *ptr)
    return After(u, p, v + B.T @ p, rounds)


def energy(M: Floats, v: Floats) -> float:
    return 0.5 * float(v @ M @ v)


def row_of_balls(masses: Sequence[float], v: Sequence[float], e: float) -> Problem:
    """Balls on a line that touch: one contact between neighbours."""
    n = len(masses)
    J = np.zeros((3 * (n - 1), n))
    for i in range(n - 1):
        J[3 * i, i], J[3 * i, i + 1] = -1.0, 1.0
    contacts = [Contact(CONSTANT, e, 0.0, 1e-9) for _ in range(n - 1)]
    return np.diag(np.array(masses, float)), J, np.array(v, float), contacts


def random_system(rng: np.random.Generator) -> Problem:
    """Bodies with a dense mass matrix, contacts some of which are doubled, any e and friction."""
    nv, n = 3 * int(rng.integers(1, 6)), int(rng.integers(1, 13))
    A = rng.normal(size=(nv, nv))
    M = A @ A.T / nv + np.diag(10.0 ** rng.uniform(-2, 2, nv))
    J = rng.normal(size=(3 * n, nv))
    if n > 2 and rng.random() < 0.3:
        J[3:6] = J[:3]
    contacts = []
    for _ in range(n):
        kind = int(rng.integers(0, 3))
        value = rng.choice([0.0, 1.0, rng.random()])
        mu = rng.choice([0.0, rng.uniform(0, 2)])
        contacts.append(Contact(kind, value, mu, 1e-9))
    return M, J, rng.normal(size=nv), contacts


def test_energy_never_grows_and_forces_keep_their_cones() -> None:
    rng = np.random.default_rng(1)
    for _ in range(1500):
        M, J, v, contacts = random_system(rng)
        after = collide(M, J, v, contacts)
        assert energy(M, after.v) <= energy(M, v) * (1 + 1e-12)
        np.testing.assert_allclose(after.u, J @ after.v, atol=1e-9 * (1 + np.abs(after.u).max()))
        for c, p in zip(contacts, after.p.reshape(-1, 3), strict=True):
            assert p[0] >= 0.0
            assert np.hypot(p[1], p[2]) <= 1.0101 * c.friction * p[0] + 1e-12


def test_what_gravity_does_in_the_step_adds_no_energy_either() -> None:
    rng = np.random.default_rng(2)
    for _ in range(300):
        M, J, v, contacts = random_system(rng)
        for c in contacts:
            c.lift, c.lag = float(rng.choice([0.0, rng.uniform(-1, 1)])), rng.uniform(0, 1)
        # Bodies squeezed from all sides: impulses, and their rounding, are many times the momentum.
        assert energy(M, collide(M, J, v, contacts).v) <= energy(M, v) * (1 + 1e-9)


def under_gravity(contact: Contact, x: float, v: float, gain: float, h: float) -> float:
    """Return the rate, m/s, at which a body leaves a step h of
    semi-implicit Euler with an impact in it.

    x, v: depth and approach rate as the step begins. gain: gravity towards the
    contact, m/s². Impacts are between rates that have half of the step's gravity; the
    body then gains the other half.
    """
    lib = _compile.law_library()
    lib.hcb_under_gravity(ctypes.byref(contact), *map(ctypes.c_double, (x, v, gain, h)), 0)
    after = collide(
        np.eye(1), np.array([[1.0], [0.0], [0.0]]), np.array([-v - gain * h / 2]), [contact]
    )
    return float(after.u[0]) - gain * h / 2


def test_a_body_leaves_the_step_with_e_squared_of_what_its_flight_keeps() -> None:
    """(v + g h/2)² - 2 g x is 1.05² - 0.1 before: the square of the speed at the touch plane."""
    leaves = under_gravity(Contact(CONSTANT, 0.5, 0.0, 1e-9), 0.005, 1.0, 10.0, 0.01)
    kept = (leaves + 0.05) ** 2 - 2 * 10.0 * 0.005
    assert kept == pytest.approx(0.25 * (1.05**2 - 0.1), rel=1e-12)


def test_a_body_that_touched_before_leaves_at_e_times_its_rate() -> None:
    """Deeper than a step of its own brings it: the impact is at the step's
    start, then gravity takes g h.
    """
    leaves = under_gravity(Contact(CONSTANT, 0.5, 0.0, 1e-9), 0.1, 1.0, 10.0, 0.01)
    assert leaves == pytest.approx(0.5 * 1.0 - 10.0 * 0.01, rel=1e-12)


@pytest.mark.parametrize("x", [0.0, 0.1])
def test_gravity_within_the_step_makes_no_impact_of_rest(x: float) -> None:
    """Rates up to `still` at the step's start count as rest, before gravity adds to them."""
    for rate, is_impact in ((0.29, False), (0.31, True)):
        contact = Contact(CONSTANT, 0.5, 0.0, 0.3)
        under_gravity(contact, x, rate, 10.0, 0.01)
        assert (rate + 10.0 * 0.01 / 2 > contact.still) == is_impact


def test_a_single_contact_gets_its_restitution_whatever_the_friction() -> None:
    rng = np.random.default_rng(3)
    worst = 0.0
    for _ in range(500):
        M, J, v, _ = random_system(rng)
        if J[0] @ v > 0:
            v = -v
        kind, value = int(rng.integers(0, 3)), rng.uniform(0, 1)
        speed = -float(J[0] @ v)
        e = {
            LAW: float(restitution(value, speed)),
            LINEAR: max(0.0, 1 - value * speed),
            CONSTANT: value,
        }[kind]
        mu = rng.choice([0.0, rng.uniform(0, 1)])
        after = collide(M, J[:3], v, [Contact(kind, value, mu, 1e-9)])
        gains = energy(M, after.v) > energy(M, v) * (1 + 1e-12)
        assert not gains
        worst = max(worst, abs(after.u[0] / speed - e))
        assert np.hypot(*after.p[1:]) <= mu * after.p[0] * (1 + 1e-9)
    assert worst < 1e-9


def test_coupled_contacts_part_at_the_e_of_their_own_speeds() -> None:
    """Two ends of a rod, which land at 1.2 and 0.8 m/s by laws of their own."""
    rod, J = np.diag([1.0, 1.0 / 12.0]), np.zeros((6, 2))
    J[0], J[3] = [1.0, 0.5], [1.0, -0.5]
    contacts = [Contact(LAW, 0.3, 0, 0), Contact(CONSTANT, 0.2, 0, 0)]
    after = collide(rod, J, np.array([-1.0, -0.4]), contacts)
    assert after.u[0] == pytest.approx(1.2 * restitution(0.3, 1.2), abs=1e-9)
    assert after.u[3] == pytest.approx(0.8 * 0.2, abs=1e-9)


def tilted_face(friction: float) -> Problem:
    """A cube of 1 kg and 0.2 m that lands on its face's four corners at
    0.5 ... 1.5 m/s, by a law under which no motion of a cube has all four
    parting speeds.
    """
    corners = [np.array([0.1 * x, 0.1 * y, -0.1]) for x in (-1, 1) for y in (-1, 1)]
    axes = np.eye(3)[[2, 0, 1]]
    J = np.array([np.r_[d, np.cross(r, d)] for r in corners for d in axes])
    M = np.diag([1.0] * 3 + [1 / 150] * 3)
    v = np.array([0.7, 0.2, -1.0, 3.0, 2.0, 0.5])
    return M, J, v, [Contact(LAW, 0.3, friction, 1e-9) for _ in corners]


def test_corners_of_a_face_push_until_one_lets_go() -> None:
    """Each parts at its own speed, or faster and without an impulse, to rounding."""
    M, J, v, contacts = tilted_face(0.0)
    after = collide(M, J, v, contacts)
    came = -(J @ v)[::3]
    missing = after.u[::3] - came * restitution(0.3, came)
    assert after.rounds == 1
    assert (after.p[::3] == 0.0).sum() == 1
    np.testing.assert_allclose(missing[after.p[::3] > 0.0], 0.0, atol=1e-9)
    assert (missing > -1e-9).all()


def test_corners_of_a_face_that_rub_stick_or_slide_against_their_slip() -> None:
    """Coulomb's law of each, to 1e-6 of the speeds."""
    M, J, v, contacts = tilted_face(0.2)
    after = collide(M, J, v, contacts)
    slides = 0
    for u, p in zip(after.u.reshape(-1, 3)[:, 1:], after.p.reshape(-1, 3), strict=True):
        slip, rubbed = float(np.hypot(*u)), p[1:]
        if p[0] == 0.0 or slip < 1e-6:
            continue
        np.testing.assert_allclose(rubbed, -0.2 * p[0] * u / slip, atol=1e-6)
        slides += 1
    assert slides > 0


@pytest.mark.parametrize("speed", [0.46, 0.44114, 0.3, 0.1])
def test_a_cube_that_slides_and_nearly_tips_is_rubbed_at_its_front(speed: float) -> None:
    """Corners at the back bear nothing, but for a rounding, which counted as friction out of its
    cone: so such a cube slid on for ever.
    """
    corners = [np.array([x, y, -0.05]) for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    J = np.array([np.r_[d, np.cross(r, d)] for r in corners for d in np.eye(3)[[2, 0, 1]]])
    M, v = np.diag([1.0] * 3 + [0.005 / 3] * 3), np.array([speed, 0, -0.02, 0, 0, 0])
    after = collide(M, J, v, [Contact(CONSTANT, 0.0, 1.0, 2e-4) for _ in corners])
    assert after.v[0] == pytest.approx(speed - 0.02, abs=1e-6)
    np.testing.assert_allclose(after.v[1:], 0.0, atol=1e-6)


@pytest.mark.parametrize(("n", "incoming"), [(2, 1), (5, 1), (5, 2), (10, 3)])
def test_elastic_row_sends_out_as_many_as_come_in(n: int, incoming: int) -> None:
    v = [1.0] * incoming + [0.0] * (n - incoming)
    after = collide(*row_of_balls([1.0] * n, v, 1.0))
    np.testing.assert_allclose(after.v, v[::-1], atol=1e-9)


def test_inelastic_row_is_one_binary_impact_after_another() -> None:
    after = collide(*row_of_balls([1.0] * 5, [1, 0, 0, 0, 0], 0.9))
    assert after.v[-1] == pytest.approx(0.95**4, abs=1e-9)
    assert after.v[0] == pytest.approx(0.05, abs=0.01)


def test_symmetric_blows_stay_symmetric() -> None:
    after = collide(*row_of_balls([1.0] * 3, [1, 0, -1], 0.9))
    np.testing.assert_allclose(after.v, [-0.9, 0, 0.9], atol=1e-12)


def test_slow_approaches_are_left_alone() -> None:
    M, J, v, contacts = row_of_balls([1.0, 1.0], [1e-3, 0.0], 0.5)
    contacts[0].still = 2e-3
    after = collide(M, J, v, contacts)
    assert after.rounds == 0
    np.testing.assert_array_equal(after.v, v)


def test_sliding_ball_keeps_coulombs_impulse_and_a_slow_one_sticks() -> None:
    M = np.diag([1.0] * 3 + [0.4 * 0.05**2] * 3)  # a ball of radius 50 mm: z up, contact below
    r = np.array([0.0, 0.0, -0.05])
    J = np.array([np.r_[d, np.cross(r, d)] for d in np.eye(3)[[2, 0, 1]]])
    v = np.array([2.0, 0.0, -0.3, 0.0, 0.0, 0.0])
    sliding = collide(M, J, v, [Contact(CONSTANT, 0.9, 0.1, 1e-9)])
    np.testing.assert_allclose(sliding.p, [0.57, -0.057, 0.0], atol=1e-12)
    sticking = collide(M, J, v, [Contact(CONSTANT, 0.9, 2.0, 1e-9)])
    np.testing.assert_allclose(sticking.v[0], 2.0 * 5 / 7, atol=1e-12)
    assert sticking.u[0] == pytest.approx(0.27, abs=1e-12)
