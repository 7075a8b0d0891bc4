"""MuJoCo Warp behind the contract of an engine: it steps MJCF models, many at once.

Options of a setting: those of MuJoCo, and
    law: {"kind": "restitution", ...} for e(v) set in each step, or {"kind": "force", ...} in place
    of the
        contact, as `hcbench.laws.contact_law.law_of` reads them.
    device: "cpu" or "gpu": all launches are one batch there, and no step leaves it.

Of several <pair>s of the same two geoms it keeps one, without a warning: its scenes have a
copy of the ball's geom for each.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from functools import cache, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from hcbench.laws.conventions import OneContact, SystemValue, Vocabulary
from hcbench.sim.backend import Backend
from hcbench.sim.capabilities import DescribesContact
from hcbench.sim.read_impact import EACH, WHOLE, Reading, Rule, reader
from hcbench.sim.scripted import batch_in, free_memory, law_text, no_gpu, run_lines
from hcbench.sim.shared_model import Copies, SharedModelEngine
from hcbench.system.errors import EngineFailed, SceneError
from hcbench.terms.setting import PAIR

if TYPE_CHECKING:
    from hcbench.sim.scripted import PythonLaw
    from hcbench.terms.impact import Floats
    from hcbench.terms.scene import Scene
    from hcbench.terms.setting import Pair, Setting


# Steps between two looks at which balls have ended.
_LOOK = 8
# Fields of a state that stay as the user has set them, and what its solver begins with.
_HELD = (
    "ctrl",
    "act",
    "mocap_pos",
    "mocap_quat",
    "eq_active",
    "qfrc_applied",
    "xfrc_applied",
    "qacc_warmstart",
)
# Memory that a copy takes, bytes: 7 kB were measured.
_BYTES = 8_000
# A step of one world costs as much as of all of them.
_PLACES = 128
# Steps between two looks.
_MOST_STEPS = 64
# Contacts of a world, and constraints, of a user's model: Warp's own bound is 48.
_MOST_CONTACTS = 256


_CAVEATS = (
    "MuJoCo Warp keeps one of several pairs of the same two geoms; solimp powers above 100 underflow.",
)


class MujocoWarpEngine(DescribesContact, SharedModelEngine):
    """The engine MuJoCo Warp 4.0."""

    name = "mujoco-warp"
    title = "MuJoCo Warp"
    backend = Backend("mujoco-warp", "mujoco-warp", "4.0", "4.0")
    bits = 32
    own_process = True
    # Seconds: Warp compiles some 40 kernels when first used.
    limit = 600.0
    together = _PLACES
    suffixes = (".xml", ".mjcf", ".mjb")
    model_engine = "mujoco"
    # MuJoCo's, of two geoms.
    default_friction = 1.0
    lacks = frozenset({"several pairs"})
    devices = ("cpu", "gpu")

    def script(self, scene: Scene, setting: Setting) -> str:
        """MuJoCo's scene, with a geom for each pair."""
        return with_a_geom_each(super().script(scene, setting))

    def snippet(self, setting: Setting, form: str, pair: Pair = PAIR) -> str:
        """Text of a setting to paste: the MJCF of its <pair>s, with a comment on the copies of the
        geom that several need; with a law, a Python script whose step has the law.

        form: "cup" for limits of a tendon, else <pair>s.
        pair: names of the two geoms.
        """
        text = super().snippet(setting, form, pair)
        if self.law(setting) is not None:
            return _SCRIPT.format(text)
        if text.count("<pair ") > 1:
            text += "\n<!-- as geom1, each pair needs its own massless copy of the ball's geom -->"
        return text

    def law_lines(self, law: PythonLaw | None, pair: Pair = PAIR) -> str:
        """Lines that put a law into `model`, an MjModel, or into `m`, what MuJoCo Warp made of it;
        they define `step`, which takes the place of `mjw.step`.
        """
        return law_text(law, _EACH, _FORCE, pair)

    def copies(
        self,
        model: Any,
        start: Any,
        bits: int = 0,
        law: str = "",
        radius: float = 0.0,
        device: str = "",
    ) -> WarpCopies:
        """Copies of a model on one device.

        model: MjModel.
        start: MjData of what states leave out.
        bits: unused, as Warp computes in float32.
        law: lines that define the step; "" for MuJoCo Warp's own.
        radius: of the ball, m; 0 for a user's model.
        device: "cpu" or "gpu"; "" for the one that Warp prefers.

        Raises SceneError for what Warp does not have, CannotRun without the device.
        """
        warp = self.backend.module("warp")
        mujoco_warp = self.backend.module("mujoco_warp")
        warp.config.quiet = True
        where = self._device(device)
        warp.set_device(where)
        try:
            on_device = mujoco_warp.put_model(model)
        except (NotImplementedError, ValueError) as error:
            raise SceneError("model", f"MuJoCo Warp: {error}", "what it has of MuJoCo") from None
        known = {"mjw": mujoco_warp, "model": model, "m": on_device}
        # A ball on a plane has few; a user's model may have any.
        most = int(model.npair) + 4 if radius else _MOST_CONTACTS
        copies = WarpCopies(model, start, most, run_lines(law or "step = mjw.step", known))
        if device:
            copies.room = batch_in(where.free_memory if where.is_cuda else free_memory(), _BYTES)
        return copies

    def require_device(self, device: str) -> None:
        """Raises CannotRun where Warp sees no such device."""
        self._device(device)

    def _device(self, device: str) -> Any:
        """Warp's device of a kind, "" for the one it prefers. Raises CannotRun without a GPU."""
        warp = self.backend.module("warp")
        if device == "gpu" and not warp.is_cuda_available():
            raise no_gpu(self.name, "Warp", "Install NVIDIA's driver")
        if not device:
            return warp.get_preferred_device()
        return warp.get_device(device.replace("gpu", "cuda"))

    def vocabulary(self, contact: OneContact) -> Vocabulary:
        """MuJoCo Warp's solref for a bounce in one step, if the contact has an e and a step; with
        caveats.
        """
        e = contact.restitution
        h = contact.timestep
        if e is None or h is None:
            return Vocabulary(caveats=_CAVEATS)
        note = "without friction, bounces in one step; solimp 0.9999 0.9999 0.001"
        value = SystemValue("MuJoCo Warp", "solref", (0.0, -(1.0 + e) / h), "", note)
        return Vocabulary((value,), caveats=_CAVEATS)


def with_a_geom_each(xml: str) -> str:
    """MJCF in which each pair but the first has a massless copy of its first geom for itself.

    xml: the MJCF with its <pair> elements.
    MuJoCo Warp keeps one pair of two geoms only.
    """
    root = ET.fromstring(xml)
    # Each geom by its name, with the body that has it.
    holders = {}
    for body in root.iter():
        for geom in body.findall("geom"):
            holders[geom.get("name")] = (body, geom)
    # Copies are numbered from 2 on.
    for number, pair in enumerate(root.findall("contact/pair")[1:], 2):
        body, original = holders[pair.get("geom1")]
        made = copy.deepcopy(original)
        name = f"{pair.get('geom1')} {number}"
        made.set("name", name)
        # It collides by its pair alone, and viewers do not draw the group 3.
        made.attrib.update(mass="0", contype="0", conaffinity="0", group="3")
        body.append(made)
        pair.set("geom1", name)
    return ET.tostring(root, encoding="unicode")


class WarpCopies(Copies):
    """Copies of a model on one device.

    places: launches at once.
    bits, kind: of its numbers.
    """

    places = _PLACES
    bits = 32
    kind = np.float32

    def __init__(self, model: Any, start: Any, most: int, names: dict[str, Any]) -> None:
        self._model = model
        self._start = start
        self._most = most
        self._engine = names["mjw"]
        self._on_device = names["m"]
        self._step = names["step"]

    def place(self, states: Floats) -> Floats:
        """Put the copies into states, and return these rounded to float32, (b, nq + nv).

        states: positions, then velocities, SI, (b, nq + nv).
        All else is as in the user's state.
        """
        # `put_data` would send all arrays of all worlds; most are zero.
        self._data = self._engine.make_data(
            self._model, nworld=len(states), nconmax=self._most, njmax=self._most
        )
        for name in _HELD:
            one = getattr(self._start, name)
            if one.size:
                copies = np.broadcast_to(one, (len(states), *one.shape))
                getattr(self._data, name).assign(copies)
        self._data.qpos.assign(states[:, : self._model.nq].astype(np.float32))
        self._data.qvel.assign(states[:, self._model.nq :].astype(np.float32))
        return self._state()

    def step(self, steps: int) -> Floats:
        """States after each of up to `steps` steps, (n, b, nq + nv): as many as are worth a look.

        Raises EngineFailed where a copy has more contacts than there is room for.
        """
        path = []
        for _ in range(min(steps, _MOST_STEPS)):
            self._take_step()
            path.append(self._state())
        self._require_room()
        return np.array(path)

    def read_on(self, rule: Rule, reading: Reading, fewest: int, most: int) -> Reading:
        """Step, and read balls by a kernel after each step, until few of them go on.

        rule: how an impact ends.
        reading: of each ball until now; returned as it is then.
        fewest: balls that may still go on.
        most: steps.
        This process looks every _LOOK steps, so more are taken; on a GPU the steps between are a
        graph.
        Raises EngineFailed where a copy has more contacts than there is room for.
        """
        import warp

        read = _reading_kernel(warp)
        count = _counting_kernel(warp)
        # All on the device: the readings, the numbers of the rule, and what the kernel takes.
        now = Reading(*map(warp.array, reading))
        constants = [warp.array(number) if number.ndim else number.item() for number in rule]
        inputs = [self._data.qpos, self._data.qvel, *constants, *now]
        # Balls that go on, and the most steps of one.
        progress = warp.zeros(2, dtype=int)

        def take_steps() -> None:
            """Take _LOOK steps, each with its reading, and count how far the balls are."""
            for _ in range(_LOOK):
                self._take_step()
                warp.launch(read, dim=self._data.nworld, inputs=inputs)
            progress.zero_()
            warp.launch(count, dim=self._data.nworld, inputs=[now.end, now.steps, progress])

        # An end of 0: not ended.
        going = np.count_nonzero(reading.end == 0)
        steps = reading.steps.max()
        run = take_steps
        while going > fewest and steps < most:
            run()
            going, steps = progress.numpy()
            # A graph takes kernels that have run before.
            if run is take_steps and progress.device.is_cuda:
                with warp.ScopedCapture() as capture:
                    take_steps()
                run = partial(warp.capture_launch, capture.graph)
        self._require_room()
        return Reading(*(column.numpy() for column in now))

    def _take_step(self) -> None:
        self._step(self._on_device, self._data)

    def _require_room(self) -> None:
        if self._data.overflow.numpy().any():
            got = f"a copy has more than {self._most} contacts or constraints"
            raise EngineFailed("mujoco-warp", got, "fewer", "Measure a model of the two alone")

    def _state(self) -> Floats:
        return np.hstack([self._data.qpos.numpy(), self._data.qvel.numpy()]).astype(np.float64)


def _both(a: bool, b: bool) -> bool:
    return a and b


def _either(a: bool, b: bool) -> bool:
    return a or b


@cache
def _reading_kernel(warp: Any) -> Any:
    """`hcbench.sim.read_impact.reader` as a kernel of Warp: a ball's reading in each thread.

    Warp compiles source text, so the kernel is written as text: the fields of Rule and Reading are
    its arguments, arrays where each ball has a number of its own.
    """
    library = SimpleNamespace(
        abs=warp.abs,
        where=warp.where,
        logical_and=warp.func(_both),
        logical_or=warp.func(_either),
    )
    add = reader(library)
    names = (*Rule._fields, *Reading._fields)
    # Warp compiles no function without annotations.
    add.__annotations__ = dict.fromkeys(("height_after", "rising_after", *names), Any)
    parameters = ["qpos: wp.array2d[float]", "qvel: wp.array2d[float]"]
    arguments = ["qpos[i, 2]", "qvel[i, 2]"]
    for name in names:
        kind = "int" if name in WHOLE else "float"
        # Some fields of the rule are one number for all balls.
        if name in EACH or name in Reading._fields:
            parameters.append(f"_{name}: wp.array[{kind}]")
            arguments.append(f"_{name}[i]")
        else:
            parameters.append(f"_{name}: {kind}")
            arguments.append(f"_{name}")
    lines = [
        "@wp.kernel",
        f"def read({', '.join(parameters)}):",
        "    i = wp.tid()",
        f"    {', '.join(Reading._fields)} = add({', '.join(arguments)})",
        *(f"    _{name}[i] = {name}" for name in Reading._fields),
    ]
    return run_lines("\n".join(lines), {"wp": warp, "add": warp.func(add)})["read"]


@cache
def _counting_kernel(warp: Any) -> Any:
    """A kernel of Warp that counts the balls which go on, and finds the most steps of one.

    It is made once: Warp compiles each kernel that it is given anew.
    """
    return run_lines(_COUNT, {"wp": warp})["count"]


_COUNT = """\
@wp.kernel
def count(end: wp.array[int], steps: wp.array[int], progress: wp.array[int]):
    i = wp.tid()
    if end[i] == 0:
        wp.atomic_add(progress, 0, 1)
    wp.atomic_max(progress, 1, steps[i])"""
_FORCE = """\
import warp as wp

@wp.kernel
def push(qpos: wp.array2d[float], qvel: wp.array2d[float], radius: float, out: wp.array2d[float]):
    world = wp.tid()  # the pair's own contact is off; the plane is z = 0
    x = radius - qpos[world, 2]
    if x > 0.0:
        force = float({k}) * wp.pow(x, float({n})) * (1.0 - float({a}) * qvel[world, 2])
        out[world, 2] = out[world, 2] + wp.max(force, 0.0)

def passive(m, d):
    inputs = [d.qpos, d.qvel, float(model.geom("{geom}").size[0])]
    wp.launch(push, dim=d.nworld, inputs=inputs, outputs=[d.qfrc_passive])

m.callback.passive = passive
step = mjw.step"""
_EACH = """\
from hcbench.contact.warp import Restitution, restitution

step = restitution(model, {{("{first}", "{second}"): Restitution({alpha}, "{reading}")}})"""
_SCRIPT = """\
import mujoco
import mujoco_warp as mjw

model = mujoco.MjModel.from_xml_path("my.xml")
m, d = mjw.put_model(model), mjw.make_data(model, nworld=1024)

{}

for _ in range(1000):
    step(m, d)  # in place of mjw.step"""
