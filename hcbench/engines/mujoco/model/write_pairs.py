"""Writes contact rows into a model of the user's, as <pair> elements."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from hcbench.engines.mujoco.backend import backend
from hcbench.engines.mujoco.model.bodies import body_name, response
from hcbench.engines.mujoco.model.list_pairs import contact_in_force
from hcbench.engines.mujoco.model.row_choices import Load, estimated_mobility
from hcbench.engines.mujoco.model.written_model import spec_of, taken_pairs
from hcbench.engines.mujoco.recipes.compliant_fit import IMPRATIO
from hcbench.engines.mujoco.scene.elements import quoted
from hcbench.engines.mujoco.scene.mjcf import numbers_text
from hcbench.engines.mujoco.scene.rows import MAX_IMPEDANCE, MIN_IMPEDANCE, ConstraintRow

if TYPE_CHECKING:
    from collections.abc import Sequence

    from hcbench.engines.mujoco.model.place import PairAtTouch
    from hcbench.engines.mujoco.model.under_test import MujocoModel
    from hcbench.sim.model_under_test import Request

_numbers = partial(numbers_text, number="{:.10g}".format)

Rows = tuple[ConstraintRow, ...]


@dataclass(frozen=True)
class PairToTune:
    """Pair in the user's model, with the launches and the load that its contact has to serve.

    requests: its launches, one for each attitude.
    opened: the model under each.
    like: equal for pairs that are alike, such as the feet of a robot.
    """

    requests: tuple[Request, ...]
    opened: tuple[MujocoModel, ...]
    geoms: tuple[tuple[int, int], ...]
    load: Load
    like: tuple[object, ...]

    @property
    def place(self) -> PairAtTouch:
        """The pair at touch in its first attitude."""
        return self.opened[0].place

    @cached_property
    def band(self) -> tuple[float, float]:
        """Lowest and highest launch speed, m/s."""
        return min(self.requests[0].speeds), max(self.requests[0].speeds)


class Written(NamedTuple):
    """A spec with rows in it, what was written, and what to know.

    own: whether the user's text can stay.
    """

    spec: Any
    lines: str
    notes: list[str]
    names: dict[int, str]
    own: bool


def written(source: Any, pairs: Sequence[tuple[PairToTune, Rows]]) -> Written:
    """The model of a source with rows for its pairs, in a spec of its own."""
    spec = spec_of(source)
    model = spec.compile()
    lines: list[str] = []
    notes: list[str] = []
    geoms: list[tuple[int, int]] = []
    for pair, _ in pairs:
        geoms += pair.geoms
    names = _name_geoms(spec, model, geoms, notes)
    own = not notes and not taken_pairs(model, geoms)
    for pair, rows in pairs:
        for one, other in pair.geoms:
            lines += _write_rows(spec, model, pair, (one, other), (names[one], names[other]), rows)
    option = ""
    impratio = needed_impratio(model, pairs)
    if impratio > 0.0:
        spec.option.cone = backend().mjtCone.mjCONE_ELLIPTIC
        spec.option.impratio = impratio
        option = f'<option cone="elliptic" impratio="{impratio:g}"/>\n'
        notes.append(
            f"cone and impratio are of the whole model: elliptic and {impratio:g}, so that friction neither "
            "throws up what slides nor slips; other contacts change a little."
        )
    text = f"{option}<contact>\n" + "\n".join(f"  {line}" for line in lines) + "\n</contact>"
    return Written(spec, text, notes, names, own)


def needed_impratio(model: Any, pairs: Sequence[tuple[PairToTune, Rows]]) -> float:
    """The impratio with which no pair drifts faster than in the model as
    it is; 0 where its own will do.

    A friction row holds a load by a slip of R_t/(A b), R_t = R_n/impratio, R_n/A = (1 - d)/d.
    """
    own = float(model.opt.impratio)
    needed = 0.0
    for pair, rows in pairs:
        if not pair.load.slides:
            continue
        if rows[0].solimp[0] == MIN_IMPEDANCE:
            return IMPRATIO
        now = contact_in_force(model, *pair.geoms[0])
        # The user's contact is judged where it lies deep, at its full impedance.
        before = _slip(now["solref"], now["solimp"], now["solimp"][1])
        needed = max(
            needed, own * _slip(rows[0].solref, rows[0].solimp, rows[0].solimp[0]) / before
        )
    return float(f"{1.1 * needed:.1g}") if needed > own else 0.0


def _slip(solref: Sequence[float], solimp: Sequence[float], impedance: float) -> float:
    """Slip of a friction row under a load, at an impedance, but for what all have in common, s."""
    d, dmax = (min(max(number, MIN_IMPEDANCE), MAX_IMPEDANCE) for number in (impedance, solimp[1]))
    damping = -solref[1] if solref[0] <= 0.0 else 2.0 / max(solref[0], 1e-6)
    return (1.0 - d) / d * dmax / max(damping, 1e-6)


def mass_note(place: PairAtTouch) -> list[str]:
    """A note on the effective mass of a pair that moves as a whole."""
    model = place.pair.model
    bodies = (place.pair.first.body, place.pair.second.body)
    if not all(model.body_weldid[body] for body in bodies):
        return []
    one = body_name(model, bodies[0])
    return [
        f"Both bodies move: the effective mass is {place.effective_mass:.4g} kg, less than that of {one!r}."
    ]


def _write_rows(
    spec: Any,
    model: Any,
    pair: PairToTune,
    geoms: tuple[int, int],
    names: tuple[str, str],
    rows: Rows,
) -> list[str]:
    """Set or add the <pair>s of two geoms in a spec, one for each row, the first with friction.

    model: compiled, as it was before. Returns the lines of XML that a user can paste.
    """
    before = contact_in_force(model, *geoms)
    place = pair.place
    first, second = model.geom_bodyid[list(geoms)].tolist()
    # MuJoCo's estimates of mass differ between links, though these bounce as one.
    share = estimated_mobility(model, first, second)
    share /= estimated_mobility(model, place.pair.first.body, place.pair.second.body)
    known = [p for p in spec.pairs if {p.geomname1, p.geomname2} == set(names)]
    for extra in known[1:]:
        spec.delete(extra)
    # MuJoCo scales a soft row by its own estimate of the mass; a stiff one sets the acceleration.
    is_soft = rows[0].solimp[0] == MIN_IMPEDANCE
    scale = 1.0
    if is_soft:
        scale = share
    lines = []
    for i, row in enumerate(rows):
        values: dict[str, Any] = {
            "solref": [number * scale for number in row.solref],
            "solimp": list(row.solimp),
        }
        if i > 0:
            values["condim"] = 1
        elif not known:
            sliding, torsional, rolling = before["friction"]
            values["condim"] = int(before["condim"])
            values["friction"] = [sliding, sliding, torsional, rolling, rolling]
        if i == 0 and is_soft and pair.load.slides:
            values["solreffriction"] = [0.0, -_friction_damping(place, pair.load)]
        if row.adhesion:
            values["adhesion"] = row.adhesion
        if place.contact.onset or known:
            values |= {"margin": place.contact.onset, "gap": 0.0}
        if known and i == 0:
            element = known[0]
        else:
            element = spec.add_pair(geomname1=names[0], geomname2=names[1])
        lines.append(_set(element, names, values))
    return lines


def _set(element: Any, names: tuple[str, str], values: dict[str, Any]) -> str:
    """Set attributes of a <pair>, and return its line of XML."""
    attributes = []
    for name, value in values.items():
        field = getattr(element, name)
        if isinstance(value, list):
            field[: len(value)] = value
            text = _numbers(value)
        else:
            setattr(element, name, value)
            text = f"{value:g}"
        attributes.append(f'{name}="{text}"')
    first, second = map(quoted, names)
    return f"<pair geom1={first} geom2={second} {' '.join(attributes)}/>"


def _friction_damping(place: PairAtTouch, load: Load) -> float:
    """1/s, of friction rows that together stop a slip in one step, along
    the way that slides most easily.
    """
    model = place.pair.model
    data = backend().MjData(place.pair.model)
    data.qpos[:] = place.qpos
    backend().mj_forward(model, data)
    normal = place.contact.normal
    across = np.linalg.svd(normal[None])[2][1:]
    rows = np.array([place.pair.approach_row(data, place.contact.point, way) for way in across])
    mobility = rows @ np.array([response(model, data, row) for row in rows]).T
    weight = MIN_IMPEDANCE / (1.0 - MIN_IMPEDANCE) * IMPRATIO * load.strength
    weight *= place.effective_mass * float(np.linalg.eigvalsh(mobility)[-1])
    return MIN_IMPEDANCE * (1.0 + weight) / max(weight, 1e-3) / load.timestep


def _name_geoms(
    spec: Any, model: Any, geoms: Sequence[tuple[int, int]], notes: list[str]
) -> dict[int, str]:
    """Names by which a <pair> calls geoms; those without one get one."""
    names = {}
    # By number: MuJoCo 3.3 gives the geoms of a spec no .id.
    by_id = list(spec.geoms)
    # A dict keeps each geom once, in order.
    for geom in dict.fromkeys(itertools.chain.from_iterable(geoms)):
        names[geom] = str(model.geom(geom).name)
        if not names[geom]:
            names[geom] = by_id[geom].name = f"geom_{geom}"
            body = body_name(model, int(model.geom_bodyid[geom]))
            notes.append(f'Geom {geom}, of body {body!r}, has no name: give it name="geom_{geom}".')
    return names
