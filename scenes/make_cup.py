"""Writes the concave cup of scenes/steel-cup for PyBullet: `python scenes/make_cup.py`.

cup.cdf is what the ball hits: the distance to the cup as a signed distance field, Bullet's own shape for
surfaces that are neither convex nor flat. Bullet looks it up once, at the centre of the ball, and gets one
contact whose depth is right to 1e-8 m. A triangle mesh cannot do that: its facets are nearer than the
surface by more than the penetrations of interest, or so small that thousands of them are tried in each
step, and several of them push at once.

cup.obj is what the eye sees: a solid with the same bowl, for rendering only.

Both have the lowest point of the bowl at the origin and z upwards. The same numbers give the same bytes.
"""

from __future__ import annotations

import math
import struct
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

BOWL = 0.0508  # R2 = 2 in, m
CELL = 0.0014  # edge of a cell of the field, m: its error goes with the fourth power, 9e-9 m at this size
# Cells in x and in y: an odd number, so that the axis is the middle of a cell, where the normal is exact.
ACROSS = 15
UPWARDS = 9
FLOOR = 0.0180  # height of the field's lowest corner, m; a ball of 1 in at rest has its centre at 0.0254

RIM = 0.020  # radius of the bowl's opening, m
WALL = 0.004
BASE = 0.005
AROUND, RINGS = 64, 16

Point = tuple[float, float, float]


def distance(x: float, y: float, z: float) -> float:
    """From a point inside the bowl to its surface, m."""
    return BOWL - math.sqrt(x * x + y * y + (BOWL - z) ** 2)


def cell_nodes() -> list[tuple[int, int, int]]:
    """The 32 nodes of a cubic serendipity cell in Bullet's order, in thirds of the cell's edge."""
    ends, thirds = (0, 3), (1, 2)
    corners = [(x, y, z) for z, y, x in product(ends, ends, ends)]
    along_x = [(x, y, z) for y, z, x in product(ends, ends, thirds)]
    along_y = [(x, y, z) for z, x, y in product(ends, ends, thirds)]
    along_z = [(x, y, z) for x, y, z in product(ends, ends, thirds)]
    return corners + along_x + along_y + along_z


def field(value: Callable[[float, float, float], float]) -> bytes:
    """The signed distance field in the layout that Bullet's btMiniSDF reads (little-endian)."""
    low = (-ACROSS * CELL / 2, -ACROSS * CELL / 2, FLOOR)
    cells = (ACROSS, ACROSS, UPWARDS)
    high = [corner + count * CELL for corner, count in zip(low, cells, strict=True)]
    index: dict[tuple[int, int, int], int] = {}
    values: list[float] = []
    members: list[int] = []
    for k, j, i in product(range(UPWARDS), range(ACROSS), range(ACROSS)):
        for x, y, z in cell_nodes():
            node = (3 * i + x, 3 * j + y, 3 * k + z)
            if node not in index:
                index[node] = len(values)
                values.append(value(*(a + CELL * n / 3 for a, n in zip(low, node, strict=True))))
            members.append(index[node])
    count = ACROSS * ACROSS * UPWARDS
    return b"".join(
        (
            struct.pack("<6d", *low, *high),
            struct.pack("<3I", *cells),
            struct.pack("<6d", *(3 * [CELL]), *(3 * [1.0 / CELL])),
            struct.pack("<2Q", count, 1),  # cells, fields
            struct.pack(f"<2Q{len(values)}d", 1, len(values), *values),
            struct.pack(f"<2Q{len(members)}I", 1, count, *members),
            struct.pack(f"<2Q{count}I", 1, count, *range(count)),  # every cell is present
        )
    )


def profile() -> list[tuple[float, float]]:
    """(radius, height) in m from the bowl's lowest point over rim and wall to the middle of the base."""
    steepest = math.asin(RIM / BOWL)
    angles = [steepest * ring / RINGS for ring in range(RINGS + 1)]
    bowl = [(BOWL * math.sin(a), BOWL * (1 - math.cos(a))) for a in angles]
    return [*bowl, (RIM + WALL, bowl[-1][1]), (RIM + WALL, -BASE), (0.0, -BASE)]


def solid() -> str:
    """The cup as a closed solid of revolution, Wavefront OBJ, faces counter-clockwise from outside."""
    (_, bottom), *rings, (_, base) = profile()
    points: list[Point] = [(0.0, 0.0, bottom)]
    for radius, height in rings:
        turns = [2 * math.pi * step / AROUND for step in range(AROUND)]
        points += [(radius * math.cos(t), radius * math.sin(t), height) for t in turns]
    points.append((0.0, 0.0, base))
    last = len(points)
    faces = []
    for a in range(AROUND):
        b = (a + 1) % AROUND
        faces.append((1, 2 + a, 2 + b))
        for ring in range(len(rings) - 1):
            inner, outer = 2 + ring * AROUND, 2 + (ring + 1) * AROUND
            faces.append((inner + a, outer + a, outer + b))
            faces.append((inner + a, outer + b, inner + b))
        faces.append((last - AROUND + a, last, last - AROUND + b))
    head = "# Visual shape of the cup; scenes/make_cup.py writes it.\n"
    return (
        head
        + "".join(f"v {x:.7f} {y:.7f} {z:.7f}\n" for x, y, z in points)
        + "".join(f"f {a} {b} {c}\n" for a, b, c in faces)
    )


def main(folder: Path = Path(__file__).parent / "steel-cup") -> None:
    """Write both files into `folder`."""
    (folder / "cup.cdf").write_bytes(field(distance))
    (folder / "cup.obj").write_text(solid(), encoding="ascii", newline="\n")


if __name__ == "__main__":
    main()
