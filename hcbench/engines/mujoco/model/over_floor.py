"""Height at which a robot just touches what it can land on."""

from __future__ import annotations

from collections.abc import Callable

from hcbench.system.errors import UserError

# A floor is looked for this far below a robot, and as far above one that starts inside it, m.
_FARTHEST = 10.0
# Step of that search, m, and halvings of it afterwards: after 40 the height is exact to rounding.
_SCAN = 0.01
_ROUNDS = 40


def way_up(touches: Callable[[float], bool], robot: str) -> float:
    """Height by which to raise a robot until it just clears the floor, m; below 0 to lower it.

    touches: says whether the robot touches the floor when it is raised by a height, m. Raises
    UserError where nothing is below it.
    """
    # Up, out of the floor that it is in, or down to where it first touches.
    is_in_floor = touches(0.0)
    step = _SCAN if is_in_floor else -_SCAN
    for i in range(1, round(_FARTHEST / _SCAN)):
        end = step * i
        if touches(end) is not is_in_floor:
            break
    else:
        raise UserError(
            "model",
            f"{robot!r} has nothing below to land on",
            "a floor",
            'Add a floor: <geom type="plane" size="0 0 1"/> in the worldbody',
        )
    low = end
    high = end + _SCAN
    if is_in_floor:
        low = end - _SCAN
        high = end
    for _ in range(_ROUNDS):
        middle = 0.5 * (low + high)
        if touches(middle):
            low = middle
        else:
            high = middle
    return high
