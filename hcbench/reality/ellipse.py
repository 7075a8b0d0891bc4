"""Drops of a plastic ellipse between two panes: velocities before and after 1718 first impacts.

The published tangential Jacobian has the wrong sign of its lever: with it turned, a free impulse at
the contact explains the data to 0.055 m/s (median), and to 0.77 m/s as stored.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize
from scipy.spatial.transform import Rotation

from hcbench.reality.motion import MeasuredBounces, SettingErrors, bounced, least, quaternions
from hcbench.sim.toss import Body, ContactSetting, TossModule
from hcbench.system.errors import UserError
from hcbench.terms.impact import Floats

TITLE = "ellipse drops"
UNIT = "m/s"
TRAINING = (0,)
VALIDATION = (1, 2, 3, 4)
FIXED: dict[str, float] = {}
TIMESTEP = 2e-3
DURATION = 0.06  # s
# Semi-axes and half thickness, m.
LONG = 0.035
SHORT = 0.025
THICK = 0.03
MASS = 0.037
INERTIA = MASS * (LONG**2 + SHORT**2) / 4.0
# m: turns an error of spin into one of speed.
GYRATION = np.sqrt(LONG**2 + SHORT**2) / 2.0
SHIPPED = Path(__file__).parent / "data" / "ellipse_drops.npz"
FILE = "IRB Bound/ellipse_uniform.mat"
# m/s: the copy's speed up after the impact is lower than the original's by 12 ms of gravity.
LATE = 9.81 * 0.012

# Velocities in x and z, m/s, and spin, rad/s; attitude, rad; lever of the contact's normal, m; the
# impact's number; lever of the tangent, m, as it is stored.
_COLUMNS = (
    "x before", "z before", "spin before", "x after", "z after", "spin after", "angle",
    "normal lever", "number", "tangent lever",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class EllipseImpacts:
    """Planar impacts: (x, z, spin) velocities before and after, m/s and rad/s, and attitude
    (rad), shapes (n, 3) and (n,).

    normal, tangent: rows of the contact's Jacobian, shape (n, 3): times a velocity they give the
    contact point's along the normal and the tangent, m/s. The tangent's lever has the opposite sign
    of the published one.
    numbers: of the impacts, shape (n,).
    """

    before: Floats
    after: Floats
    angle: Floats
    normal: Floats
    tangent: Floats
    numbers: Floats

    def of(self, parts: tuple[int, ...]) -> "EllipseImpacts":
        """The impacts with number % 5 in `parts`."""
        keep = np.isin(self.numbers % 5, parts)
        return EllipseImpacts(
            before=self.before[keep],
            after=self.after[keep],
            angle=self.angle[keep],
            normal=self.normal[keep],
            tangent=self.tangent[keep],
            numbers=self.numbers[keep],
        )

    def as_published(self) -> "EllipseImpacts":
        """Return the impacts with the tangent's lever as it is stored."""
        return replace(self, tangent=self.tangent * [1.0, 1.0, -1.0])

    def as_original(self) -> "EllipseImpacts":
        """Return the impacts with the original's speed up after, 12 ms of gravity more than the
        copy's.
        """
        return replace(self, after=self.after + np.array([0.0, LATE, 0.0]))


def body() -> Body:
    """The ellipse, as an ellipsoid."""
    return Body("ellipsoid", (LONG, THICK, SHORT), MASS, (INERTIA,) * 3)


def cases(parts: tuple[int, ...], folder: Path | None = None, variant: str = "") -> EllipseImpacts:
    """Impacts of parts of the data, shipped or of a folder of the original repository.

    parts: those with number % 5 among them. `variant` changes nothing.
    Raises UserError for a folder without the set's file.
    """
    if folder is None:
        with np.load(SHIPPED) as shipped:
            rows = shipped["rows"].astype(np.float64)
    else:
        rows = read(folder / FILE)
    columns = dict(zip(_COLUMNS, rows.T, strict=True))
    zero = np.zeros(len(rows))
    one = np.ones(len(rows))
    impacts = EllipseImpacts(
        # x, z and spin, m/s and rad/s.
        before=rows[:, 0:3],
        after=rows[:, 3:6],
        angle=columns["angle"],
        normal=np.stack([zero, one, columns["normal lever"]], axis=1),
        # The published lever has the wrong sign.
        tangent=np.stack([one, zero, -columns["tangent lever"]], axis=1),
        numbers=columns["number"],
    )
    return impacts.of(parts)


def read(path: Path) -> Floats:
    """Rows of the .mat file that no flag marks, shape (n, 10): velocities before and after,
    attitude, levers and number, in the order and units of `_COLUMNS`.

    Without those whose contact comes down slower than 0.5 m/s, or leaves at 1.5 times its speed or
    more.
    Raises UserError for a file that is not the set's.
    """
    from scipy.io import loadmat

    try:
        content: Any = loadmat(str(path), squeeze_me=True, struct_as_record=False)["bounce_array"]
        unmarked = [impact for impact in content if not np.any(impact.flags)]
        rows = []
        for number, impact in enumerate(unmarked):
            # Six numbers before the impact, x, z, angle and their rates, then six after it.
            angle = impact.states[2]
            before = impact.states[3:6]
            after = impact.states[9:12]
            # Last in the rows of the Jacobian, normal and tangent, are the levers of the spin, m.
            rows.append((*before, *after, angle, impact.n[2], number, impact.d[2]))
        table = np.array(rows, dtype=np.float64)
        columns = dict(zip(_COLUMNS, table.T, strict=True))
    except (OSError, KeyError, AttributeError, ValueError, TypeError, NotImplementedError) as error:
        raise UserError("--data", f"{path}: {error}", "ellipse_uniform.mat") from None
    # Upward velocity of the contact point before the impact, m/s.
    arriving = columns["z before"] + columns["normal lever"] * columns["spin before"]
    leaving = columns["z after"] + columns["normal lever"] * columns["spin after"]
    kept_rows: Floats = table[(arriving < -0.5) & (np.abs(leaving / arriving) < 1.5)]
    return kept_rows


def pack(folder: Path) -> None:
    """Write the rows that are shipped."""
    np.savez_compressed(SHIPPED, rows=read(folder / FILE).astype(np.float32))


def errors(impacts: EllipseImpacts, predicted: Floats) -> Floats:
    """Distance of the predicted velocities from the measured ones after each impact, m/s, shape
    (n,).

    predicted: x, z and spin, m/s and rad/s, shape (n, 3). Spins count times the radius of gyration.
    """
    away: Floats = np.linalg.norm((predicted - impacts.after) * [1.0, 1.0, GYRATION], axis=1)
    return away


def outcome(
    module: TossModule, setting: ContactSetting, values: tuple[float, ...], impacts: EllipseImpacts
) -> SettingErrors:
    """Errors of an engine's setting: distance of the velocities after each impact, m/s, with the
    spin times the radius of gyration.

    module: `toss` of the engine, which runs in this process.
    values: of the setting's parameters.
    Raises what the engine raises.
    """
    # The plane of the drops is x, z of the engines' world; they turn about its y.
    zero = np.zeros(len(impacts.before))
    x, z, spin_y = impacts.before.T
    attitude = quaternions(Rotation.from_rotvec(np.stack([zero, impacts.angle, zero], axis=1)))
    velocity = np.stack([x, zero, z], axis=1)
    spin = np.stack([zero, spin_y, zero], axis=1)
    bounces = MeasuredBounces(
        numbers=impacts.numbers,
        attitude=attitude,
        velocity=velocity,
        spin=spin,
        velocity_after=velocity,
        spin_after=spin,
    )
    later, turned = bounced(module, setting, values, body(), bounces, TIMESTEP, DURATION)
    away = errors(impacts, np.stack([later[:, 0], later[:, 2], turned[:, 1]], axis=1))
    return SettingErrors(away, away)


_INVERSE = np.diag([1.0 / MASS, 1.0 / MASS, 1.0 / INERTIA])


def coulomb(impacts: EllipseImpacts, e: float, friction: float) -> Floats:
    """Velocities (x, z, spin) after, m/s and rad/s, shape (n, 3), by a rigid law.

    e: Newton's, of the contact point along the normal.
    friction: Coulomb's μ; it acts in the direction of the impulse that would stop the slip.
    """
    normal = impacts.normal
    tangent = impacts.tangent
    before = impacts.before
    inward = np.einsum("ij,ij->i", normal, before)
    slip = np.einsum("ij,ij->i", tangent, before)
    # Inverse masses of the contact: change of the speed along the first by an impulse along the
    # second, 1/kg.
    nn = np.einsum("ij,jk,ik->i", normal, _INVERSE, normal)
    tt = np.einsum("ij,jk,ik->i", tangent, _INVERSE, tangent)
    nt = np.einsum("ij,jk,ik->i", normal, _INVERSE, tangent)
    # Change of the normal speed, m/s.
    parting = -(1.0 + e) * inward
    determinant = nn * tt - nt**2
    # Impulses that stop the slip; where friction cannot, it slides.
    push = (parting * tt + nt * slip) / determinant
    pull = (-nn * slip - nt * parting) / determinant
    sliding = np.abs(pull) > friction * push
    way = np.sign(pull)
    push = np.where(sliding, parting / (nn + nt * friction * way), push)
    pull = np.where(sliding, friction * way * push, pull)
    moved: Floats = before + (normal * push[:, None] + tangent * pull[:, None]) @ _INVERSE
    return moved


def fit_coulomb(impacts: EllipseImpacts) -> tuple[float, float]:
    """(e, friction) of `coulomb` that make the mean error of the impacts least, by a search from
    0.5 and 0.1.
    """

    def mean(u: Floats) -> float:
        return float(errors(impacts, coulomb(impacts, float(u[0]), abs(float(u[1])))).mean())

    (e, friction), _ = least(mean, np.array([0.5, 0.1]), 0.05)
    return float(e), abs(float(friction))


def free_impulse(impacts: EllipseImpacts) -> Floats:
    """Errors of the best impulse at the contact that adds no energy, m/s, shape (n,).

    No rigid law comes nearer to the speeds after an impact. Errors of spin count times the radius
    of gyration.
    """
    scale = np.array([1.0, 1.0, GYRATION])
    mass = np.diag([MASS, MASS, INERTIA])
    least = []
    for normal, tangent, before, later in zip(
        impacts.normal, impacts.tangent, impacts.before, impacts.after, strict=True
    ):
        columns = np.stack([_INVERSE @ normal, _INVERSE @ tangent], axis=1)
        scaled = columns * scale[:, None]
        aim = (later - before) * scale
        impulse = np.linalg.lstsq(scaled, aim, rcond=None)[0]
        energy = before @ mass @ before

        # The defaults are the numbers of this drop, whatever the loop's names mean later.
        def loss(
            u: Floats, columns: Floats = columns, before: Floats = before, energy: float = energy
        ) -> float:
            """Share of the energy that the impulse u, N s, takes away; below 0 if it adds some."""
            moved = before + columns @ u
            return float(1.0 - moved @ mass @ moved / energy)

        if loss(impulse) < 0.0:
            impulse = _bounded(scaled, aim, impulse, loss)
        least.append(float(np.linalg.norm(scaled @ impulse - aim)))
    return np.array(least)


def _bounded(scaled: Floats, aim: Floats, start: Floats, loss: Any) -> Floats:
    """The impulse nearest to a wanted change that adds no energy, N s along the normal and the
    tangent, shape (2,).

    scaled: change of the scaled state by each impulse, shape (3, 2).
    aim: wanted change of the scaled state, m/s, shape (3,).
    start: the impulse that comes nearest without regard to energy, N s, shape (2,).
    loss: share of the energy that an impulse takes away.
    """

    def square(u: Floats) -> float:
        return 1e3 * float(np.sum((scaled @ u - aim) ** 2))

    best: Any = optimize.minimize(
        square, 0.8 * start, constraints={"type": "ineq", "fun": loss}, method="SLSQP"
    )
    impulse: Floats = best.x
    return impulse
