"""Impacts of many worlds on a Warp device, for engines that step MJCF models there.

Nothing is copied to the host, and all memory is there before the second step: a step can be
captured as a graph.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from hcbench.sim.pair_laws import E, Laws, require_one_force
from hcbench.system.errors import SettingError, UserError

# Numbers of options of compiled MJCF models.
_PYRAMIDAL = 0
_SLEEP = 1 << 5
# Threads of a GPU that share out the velocities of a world: those that work in step.
_LANES = 32


class WarpImpacts:
    """Impacts of the pairs of a model, at the start of a step of the engine.

    laws: of its pairs, on the host.
    """

    def __init__(self, laws: Laws) -> None:
        self._laws = laws
        # By the name of the device.
        self._on_device: dict[str, tuple[Any, Any]] = {}
        # By an array of the worlds that they are for, with which they go.
        self._rooms: WeakKeyDictionary[Any, tuple[Any, tuple[Any, Any, Any]]] = WeakKeyDictionary()

    def step(self, engine_step: Callable[[], Any], m: Any, d: Any, values: Any = None) -> None:
        """Let the engine step, with the impacts between its search for contacts and its rows.

        engine_step: steps m and d, its model and data on a device.
        values: array there of α (s/m) or e of each pair, (worlds or 1, pairs); None: those of the
        laws.
        Raises UserError for values of another shape, and another model; SettingError for options of
        `m` with which contacts are not found once a step.
        """
        import warp

        from hcbench.sim import warp_kernels

        require_one_force(m.opt.integrator)
        if not m.opt.run_collision_detection:
            raise SettingError("run_collision_detection", "False", "True: contacts of the engine")
        laws, defaults = self._laws_on(d.qpos.device)
        chosen = defaults if values is None else self._checked(values, d.nworld)
        found, room, inertia = self._room(m, d)
        contacts = {"dim": d.naconmax, "device": d.qpos.device}
        worlds = {"dim": d.nworld, "device": d.qpos.device}
        room.first_before.fill_(-1)
        # Before the engine finds new contacts in place of the last step's.
        warp.launch(
            warp_kernels.remember,
            inputs=[found, laws, int(m.opt.cone) == _PYRAMIDAL, d.nefc, d.efc.force, room],
            **contacts,
        )
        own_filter = m.callback.contactfilter

        def collide(m: Any, d: Any) -> None:
            """Let the contacts that the engine has just found collide: kernel after kernel, each of
            which reads what those before it left in `room`. Changes velocities and springs of d.
            """
            if own_filter:
                own_filter(m, d)
            room.first.fill_(-1)
            warp.launch(warp_kernels.enlist, inputs=[found, laws, room], **contacts)
            warp.launch(warp_kernels.factor, inputs=[inertia, d.M, room], **worlds)
            tree = [m.geom_bodyid, m.body_rootid, m.body_isdofancestor, d.subtree_com, d.cdof]
            warp.launch(
                warp_kernels.span,
                dim=(d.naconmax, m.nv),
                inputs=[found, *tree, room],
                device=d.qpos.device,
            )
            options = [m.opt.timestep, m.opt.gravity, m.geom_bodyid, m.body_weldid]
            state = [d.qvel, d.qacc, d.qfrc_smooth]
            warp.launch(
                warp_kernels.aim,
                inputs=[found, laws, chosen, inertia, *options, *state, room],
                **contacts,
            )
            friction = d.contact.friction
            warp.launch_tiled(
                warp_kernels.collide,
                inputs=[found, friction, room, d.qvel],
                block_dim=_LANES,
                **worlds,
            )
            springs = [found, d.contact.solimp, m.opt.timestep, d.qvel, room]
            warp.launch(warp_kernels.settle, inputs=springs, **contacts)

        # The engine calls it between its search for contacts and its rows.
        m.callback.contactfilter = collide
        try:
            engine_step()
        finally:
            m.callback.contactfilter = own_filter
        warp.launch(warp_kernels.restore, inputs=[found, room], **contacts)

    def _checked(self, values: Any, worlds: int) -> Any:
        """`values`; UserError for another shape than (worlds or 1, pairs)."""
        pairs = self._laws.values.size
        if np.shape(values) not in ((worlds, pairs), (1, pairs)):
            got = f"an array of shape {np.shape(values)}"
            raise UserError("values", got, f"{(worlds, pairs)}: one of each world and pair")
        return values

    def _laws_on(self, device: Any) -> tuple[Any, Any]:
        """(the laws as a struct of `warp_kernels`, their values: α, s/m, or e, (1, pairs)), both in
        arrays on a Warp device; made once a device.
        """
        if device.alias not in self._on_device:
            import warp

            from hcbench.sim import warp_kernels

            laws = warp_kernels.LawsThere()
            laws.pair_of = warp.array(self._laws.pair_of, dtype=int, device=device)
            laws.reading = warp.array(self._laws.readings, dtype=int, device=device)
            laws.e = warp.array(E, dtype=float, device=device)
            values = warp.array(self._laws.values[None], dtype=float, device=device)
            self._on_device[device.alias] = laws, values
        return self._on_device[device.alias]

    def _room(self, m: Any, d: Any) -> tuple[Any, Any, Any]:
        """(contacts, room for the numbers of a step, rows of the inertia matrix) of these worlds, as
        structs of `warp_kernels`; arrays of the engine's are shared, not copied.

        m, d: the engine's model and data on a device.
        The room also keeps the forces of these worlds' last step, and is kept until another model
        steps them.
        Raises UserError for a model with another number of geoms than that of the laws,
        SettingError for worlds that sleep, in which contacts are found in two parts.
        """
        geoms = len(self._laws.pair_of)
        if m.ngeom != geoms:
            raise UserError("m", f"a model of {m.ngeom} geoms", f"that of the pairs, of {geoms}")
        if int(m.opt.enableflags) & _SLEEP:
            raise SettingError("enableflags", "sleep", "a model without")
        of_model, kept = self._rooms.get(d.qpos, (None, None))
        if kept is not None and of_model is m:
            return kept
        import warp

        from hcbench.sim import warp_kernels

        found = warp_kernels.Found()
        contact = d.contact
        found.count = d.nacon
        found.world = contact.worldid
        found.geom = contact.geom
        found.place = contact.geomcollisionid
        found.mark = contact.type
        found.dim = contact.dim
        found.dist = contact.dist
        found.margin = contact.includemargin
        found.pos = contact.pos
        found.frame = contact.frame
        found.solref = contact.solref
        found.row = contact.efc_address
        # Of the room's arrays; those that are not named here have one entry a contact.
        shapes = {
            "first": d.nworld,
            "first_before": d.nworld,
            "rows": (d.naconmax, m.nv),
            "moves": (d.naconmax, m.nv),
            "factor": d.M.shape,
            "change": (d.nworld, m.nv),
        }
        # Warp makes another class of it.
        kind_of_room: Any = warp_kernels.Room
        room = kind_of_room()
        for name, kind in kind_of_room.vars.items():
            shape = shapes.get(name, d.naconmax)
            array = warp.zeros(shape, dtype=kind.type.dtype, device=d.qpos.device)
            setattr(room, name, array)
        inertia = warp_kernels.Inertia()
        inertia.count = m.M_rownnz
        inertia.start = m.M_rowadr
        inertia.column = m.M_colind
        made = found, room, inertia
        # What a capture allocates is its graph's alone.
        if not d.qpos.device.is_capturing:
            self._rooms[d.qpos] = m, made
        return made
