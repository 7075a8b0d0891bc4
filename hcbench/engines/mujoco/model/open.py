"""A user's MuJoCo model, opened with a pair in it, and memory for its launches."""

from __future__ import annotations

import copy
import functools
import io
import re
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from hcbench.engines.mujoco import plugin
from hcbench.engines.mujoco.backend import backend, captured_warnings, keep_no_log, require_feature
from hcbench.engines.mujoco.model.bodies import integrator_name, is_whole_state, speed_reading
from hcbench.engines.mujoco.model.find_pair import find_pair
from hcbench.engines.mujoco.model.pair import WithoutContact, restitution_law
from hcbench.engines.mujoco.model.place import bring_to_touch, require_plausible_contact
from hcbench.engines.mujoco.model.start_pose import require_plausible_model, start_pose
from hcbench.sim.model_under_test import ModelUnderTest, Request, Suspect
from hcbench.sim.packages import (
    is_utf8,
    names_packages,
    read_xml,
    require_expanded,
    require_packages,
    with_absolute_files,
)
from hcbench.sim.read_impact import SpeedReading
from hcbench.system.errors import EngineFailed, SceneError
from hcbench.system.files import read_bytes, require_small_archive, why_no_file
from hcbench.system.process import memory_limit

if TYPE_CHECKING:
    from collections.abc import Callable

    from hcbench.sim.packages import Packages

# A MuJoCo model with a pair in it, opened, and the memory in which its launches are stepped.

# A body struck beside its centre turns: its effective mass is below its
# own by more than this share.
_TURNS = 1e-6
# Launches in a simulation: looking at the steps of one costs as much as at those of all.
_PLACES = 32


class OpenedModel(ModelUnderTest):
    """A MuJoCo model with a pair in it, opened: its start, its place at touch, and what launches
    leave.

    model: an MjModel, which this object may change.
    label: its name in outputs.
    state: an MjData to start from, or None.

    Raises UserError or SceneError with the reason where the pair cannot be measured, QuantityError
    for a contact that `require_plausible_contact` refuses; EngineMissing for a MuJoCo that is too
    old.
    """

    diverged = "MuJoCo found the state unstable and reset it"
    # A simulation steps no launch after it has parted, so few steps are enough at first.
    least_steps = 32

    def __init__(self, model: Any, label: str, state: Any, request: Request) -> None:
        """Bring the pair of the request to touch.

        model: an MjModel, which this object may change.
        label: its name in outputs.
        state: an MjData to start from, or None.
        Raises UserError and its kinds where the pair cannot be measured.
        """
        require_feature(backend(), "mj_copyData")
        self.model = model
        self.label = label
        self.state = state
        self.request = request
        with captured_warnings():
            self.start, self.start_name = start_pose(model, request, state)
            pair = find_pair(model, request, state)
            # A second state, which ends at touch.
            moved, _ = start_pose(model, request, state)
            self.place = bring_to_touch(pair, moved, request.coming_from, request.move)
        require_plausible_contact(model, self.place)
        self.timestep = float(model.opt.timestep)
        self.mass = self.place.effective_mass
        self.gravity = self.place.gravity
        self.energy_by_work = self.place.pair.more_than_contacts
        self.speed_reading = speed_reading(model)
        if not self._falls_freely():
            if self.speed_reading is SpeedReading.TOUCH_PLANE_EXACT_FLIGHT:
                self.speed_reading = SpeedReading.STAGED_CROSSING
            else:
                self.speed_reading = SpeedReading.CROSSING
        # Launches that a simulation may hold at once.
        self.places = _PLACES if is_whole_state(model) else 1
        # Geoms that touched the two during an impact.
        self.others: set[int] = set()
        # Texts of MuJoCo and its plug-ins while it stepped launches.
        self.warned: list[str] = []
        # Speed that each cause took off the approach, over that at touch.
        self.shares: dict[str, float] = {}

    def _falls_freely(self) -> bool:
        """Say whether the acceleration between the two bodies is constant but for the contact: not
        if joints or servos act, the second body moves, or the first one turns as it hits with a
        corner.
        """
        model = self.model
        place = self.place
        first = place.pair.first.body
        second = place.pair.second.body
        central = place.effective_mass >= (1.0 - _TURNS) * float(model.body_subtreemass[first])
        return central and not (self.energy_by_work or model.body_weldid[second])

    @abstractmethod
    def fixed(self, suspects: Sequence[Suspect]) -> OpenedModel:
        """The same pair with the fixes of `suspects` made, in a copy of the model."""

    @functools.cached_property
    def stepped(self) -> Any:
        """MjData in which launches take turns: each begins with a copy of `start` in it."""
        return copy.copy(self.start)

    @property
    def step_cost(self) -> float:
        """Grows with degrees of freedom and geoms."""
        return 1.0 + float(self.model.nv + self.model.ngeom) / 10


@dataclass(frozen=True, slots=True)
class LaunchWorkspace:
    """Memory for launches of a model, one at a time: allocating it takes as long as 500 steps.

    data: the state under way.
    seen: the state before the step; it is `data` but under RK4, which leaves another state there.
    free: for steps of RK4 without contact; None under other integrators.
    beside: for steps without contact, of pairs that a plug-in's law turns back; None for others.
    """

    data: Any
    seen: Any
    free: Any
    beside: WithoutContact | None

    @classmethod
    def of(cls, opened: OpenedModel, data: Any) -> Self:
        """Make the workspace for launches of a model that take turns in `data`; of the optional parts
        only what the model needs: those for RK4, and for a plug-in's law that turns the pair back.
        """
        mujoco = backend()
        model = opened.model
        seen = data
        free = None
        # RK4 leaves another state than that before the step in `data`.
        if integrator_name(model) == "RK4":
            seen = mujoco.MjData(model)
            free = mujoco.MjData(model)
        without = None
        if restitution_law(model, opened.place.contact.geoms) is not None:
            without = WithoutContact(model)
        return cls(data, seen, free, without)


def copy_state(model: Any, source: Any, target: Any) -> None:
    """Put `target`, an MjData, into the whole state of `source`: all that a step depends on."""
    mujoco = backend()
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, source, state, kind)
    mujoco.mj_setState(model, target, state, kind)


# A user's own MuJoCo model, from a file or an object: loaded and checked, with its start
# configuration.

SUFFIXES = (".xml", ".mjcf", ".urdf", ".mjb", ".mjz")
# Bytes that MuJoCo takes besides a model.
_BINARY_ROOM = 1 << 28


def live_state(source: Any) -> tuple[Any, Any] | None:
    """Find the MjModel and the MjData in a user's state in Python; None for anything else.

    source: an MjData, a gymnasium, dm_control or robosuite environment, or any object. The two are
    the user's own objects, not copies.
    """
    if not hasattr(source, "__dict__") and type(source).__name__ != "MjData":
        return None
    mujoco = backend()
    owner = source
    # gymnasium, dm_control and robosuite hold the model there.
    for name in ("unwrapped", "physics", "sim"):
        owner = getattr(owner, name, owner)
    model = getattr(owner, "model", None)
    data = getattr(owner, "data", None)
    # Old versions of MuJoCo give an MjData no model.
    if isinstance(source, mujoco.MjData):
        model = getattr(source, "model", None)
        data = source
    # The wrappers of dm_control ("ptr") and robosuite hold MuJoCo's own objects inside.
    for inner in ("ptr", "_model"):
        model = getattr(model, inner, model)
    for inner in ("ptr", "_data"):
        data = getattr(data, inner, data)
    is_state = isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData)
    return (model, data) if is_state else None


class UserModel(NamedTuple):
    """A user's model, loaded.

    model: compiled MjModel, of hcbench's own.
    label: its name in outputs.
    state: the user's MjData to start from; None where the source has none.
    """

    model: Any
    label: str
    state: Any


def load(source: Any, request: Request) -> UserModel:
    """Load a user's model, with the request's time step, gravity and actuators; the user's own
    objects stay as they were.

    source: a path, an MjModel, an MjSpec, MJCF text, or a state in Python: an MjData or an
    environment.

    Raises SceneError for what is not there, does not compile or has impossible numbers,
    QuantityError for numbers outside the bounds, EngineFailed where there is too little memory.
    """
    mujoco = backend()
    state = None
    kind = type(source).__name__
    # The MjModel and MjData of a state in Python.
    live = live_state(source)
    if live is not None:
        source, state = live
    keep_no_log()
    with captured_warnings() as warnings:
        if isinstance(source, mujoco.MjModel):
            label = "MjModel"
            model = copy.copy(source)
        elif isinstance(source, mujoco.MjSpec):
            label = "MjSpec"
            model = compiled(source.copy().compile, label)
        elif isinstance(source, str) and source.lstrip().startswith("<"):
            label = "MJCF text"
            model = compiled(partial(mujoco.MjModel.from_xml_string, source), label)
        elif isinstance(source, str | Path):
            label = Path(source).name
            model = _from_file(mujoco, Path(source), request.packages)
        else:
            raise SceneError("model", f"a {kind}", "a file, MJCF text, an MjModel or an MjSpec")
    if any("NaN" in line for line in warnings):
        raise SceneError(
            "model", f"{label} has a NaN in it", "numbers", "Look for 'nan' in the file"
        )
    require_plausible_model(model, label)
    # A state is called by its own type, such as MjData or that of an environment.
    if state is not None:
        label = kind
    return UserModel(as_requested(model, request), label, state)


def as_requested(model: Any, request: Request) -> Any:
    """Set the time step (s), gravity (m/s²) and actuators that a request asks for, and return the
    model, which is changed in place; what the request leaves out stays.
    """
    if request.timestep is not None:
        model.opt.timestep = request.timestep
    if request.gravity is not None:
        model.opt.gravity[:] = request.gravity
    if not request.actuators:
        model.opt.disableflags |= backend().mjtDisableBit.mjDSBL_ACTUATION
    return model


def _from_file(mujoco: Any, path: Path, packages: Packages) -> Any:
    """The model of a file: MJCF, URDF with its packages' folders, MuJoCo's binary or archive.

    packages: folders of the packages that a URDF names.

    Raises SceneError for what is not there or does not compile, EngineFailed where there is too
    little memory.
    """
    if not path.is_file():
        raise SceneError(
            "model", f"{path} {why_no_file(path)}", f"a model file: {', '.join(SUFFIXES)}"
        )
    # Python stands a surrogate for each byte of a name that it cannot decode.
    if any("\udc80" <= letter <= "\udcff" for letter in str(path)):
        raise SceneError(
            "model", f"{path} has a byte that is not UTF-8", "a name in UTF-8", "Rename the file"
        )
    if path.suffix.lower() == ".urdf":
        text = read_xml(path)
        require_expanded(path, text)
        # MuJoCo knows no packages, and its names must be UTF-8.
        if names_packages(text) or not is_utf8(path):
            return _from_urdf(mujoco, path, packages)
    if path.suffix.lower() == ".mjz":
        return compiled(partial(_unzipped, mujoco, path), str(path))
    if path.suffix.lower() == ".mjb":
        return compiled(partial(_from_binary, mujoco, path), str(path))
    return compiled(partial(mujoco.MjModel.from_xml_path, str(path)), str(path))


def _from_urdf(mujoco: Any, path: Path, packages: Packages) -> Any:
    """Compile a URDF that states another encoding, or that names files by their packages.

    Raises SceneError with the package that has no folder, or with MuJoCo's reason.
    """
    text = _keep_folders(with_absolute_files(path, packages))
    try:
        return compiled(partial(mujoco.MjModel.from_xml_string, text), str(path))
    except SceneError:
        require_packages(path, packages)
        raise


def _from_binary(mujoco: Any, path: Path) -> Any:
    """The model of a binary file, which holds its arrays as they are in memory.

    MuJoCo allocates what the sizes at the file's begin ask for before it compares them with the
    file: a damaged one could take all memory.
    Raises ValueError for sizes that no such file has, and what MuJoCo raises.
    """
    with memory_limit(_BINARY_ROOM + 4 * path.stat().st_size):
        try:
            return mujoco.MjModel.from_binary_path(str(path))
        except Exception as error:
            # Only a size that is wrong asks for so much; the message would
            # send the user to look for memory.
            if "allocate" not in str(error):
                raise
            raise ValueError(
                "its sizes ask for more memory than the file has numbers for"
            ) from None


def _unzipped(mujoco: Any, path: Path) -> Any:
    """The model of an archive that `MjSpec.to_zip` wrote: its .xml, with the files that it names.

    mujoco: the module.
    Raises ValueError for an archive that cannot be read, and what compiling raises.
    """
    try:
        content = read_bytes(path)
        require_small_archive(content)
        spec = mujoco.MjSpec.from_zip(io.BytesIO(content))
    # zipfile raises a dozen kinds of errors for a damaged archive.
    except Exception as error:
        raise ValueError(error) from None
    return spec.compile()


def _keep_folders(urdf: str) -> str:
    """A URDF's text with the option that keeps MuJoCo from stripping the folders of its files.

    MuJoCo reads the option from a <compiler> in the URDF: strippath is added to one that does not
    set it, or to a new one after <robot>.
    """
    if "<compiler" in urdf:
        return re.sub(r"<compiler(?![^>]*strippath)", '<compiler strippath="false"', urdf, count=1)
    option = '<mujoco><compiler strippath="false"/></mujoco>'
    return re.sub(r"(<robot\b[^>]*>)", rf"\1{option}", urdf, count=1)


def compiled(compile_model: Callable[[], Any], label: str) -> Any:
    """The model or spec that a function makes, with hcbench's plug-ins loaded where it names them.

    compile_model: called without arguments, a second time once the plug-ins are loaded.
    label: what to call the model in errors.
    Raises SceneError with MuJoCo's words, EngineFailed where there is too little memory.
    """
    try:
        return compile_model()
    except (ValueError, RuntimeError, TypeError, OSError) as error:
        if "plugin hcbench." in str(error) and not plugin.load.cache_info().currsize:
            plugin.load()
            return compiled(compile_model, label)
        words = " ".join(str(error).split()).removeprefix("Error: ").removeprefix("XML Error: ")
        if "allocate" in words:
            raise EngineFailed(
                "model", f"{label}: {words}", "a model that fits into memory"
            ) from None
        advice = []
        if "plugin hcbench." in words:
            advice = ["`hcbench plugin mujoco --install` installs those of this version"]
        raise SceneError(
            "model", f"{label}: {words}", "a model that MuJoCo compiles", *advice
        ) from None
