"""newton 1137: a box of a mesh falls 9 cm onto another one, and rebounds at restitution 0.

Friction, steps, solver and the grids of triangles are the asker's; the boxes' size is ours, 10 cm.
Run it with Newton's Python. Each line is one run, with the height of the rebound.
"""

from itertools import product
from typing import Any

import newton
import numpy as np
import warp

FPS, SUBSTEPS, SIZE, FALL = 50, 32, 0.1, 0.09  # the last two in m
STEP = 1 / FPS / SUBSTEPS  # s


def grid(edges: int) -> Any:
    """Mesh of a box with so many edges to a side."""
    at = np.linspace(-SIZE / 2, SIZE / 2, edges + 1)
    numbers: dict[tuple[float, ...], int] = {}
    faces: list[int] = []
    for axis, side in product(range(3), (0, edges)):
        for i, j in product(range(edges), range(edges)):
            square = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            corners = [tuple(np.roll([at[side], at[a], at[b]], axis)) for a, b in square]
            p, q, r, s = (numbers.setdefault(corner, len(numbers)) for corner in corners)
            faces += [p, q, r, p, r, s] if side else [p, r, q, p, s, r]
    return newton.Mesh(np.array([*numbers], np.float32), np.array(faces, np.int32))


def rebound(edges: int, **options: Any) -> float:
    """Height of the upper box's rebound in a second, m."""
    builder = newton.ModelBuilder()
    config = builder.ShapeConfig(restitution=0.0, mu=0.5)
    builder.add_ground_plane(cfg=config)
    for height in (SIZE / 2, 1.5 * SIZE + FALL):
        body = builder.add_body(xform=(0, 0, height, 0, 0, 0, 1))
        builder.add_shape_mesh(body=body, mesh=grid(edges), cfg=config)
    model = builder.finalize()
    now, after = model.state(), model.state()
    newton.eval_fk(model, model.joint_q, model.joint_qd, now)
    solver = newton.solvers.SolverXPBD(model, **options)
    with warp.ScopedCapture() as captured:
        solver.step(now, after, None, model.collide(now), STEP)
        now.assign(after)
    heights = []
    for _ in range(FPS * SUBSTEPS):
        warp.capture_launch(captured.graph)
        heights.append(float(now.body_q.numpy()[1, 2]))
    return max(heights[int(np.argmin(heights[: len(heights) // 4])) :]) - 1.5 * SIZE


if __name__ == "__main__":
    warp.config.quiet = True
    for edges, options in product((1, 5), ({}, {"enable_restitution": True})):
        words = f"Newton {newton.__version__}, {edges} edges to a side, {options or 'stock'}"
        print(f"{words}: {1e3 * rebound(edges, **options):.1f} mm of {1e3 * FALL:.0f}")
