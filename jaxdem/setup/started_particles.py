"""The particles of a scene that begins from another run: those of that run, those added, and those still to come."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cached_property

import numpy as np

from jaxdem.errors import InputError, number_of_tables
from jaxdem.particles.growth import moved_apart
from jaxdem.particles.regions import into_period
from jaxdem.scene.scene import Start
from jaxdem.scene.start import keys_of_added
from jaxdem.setup.arrivals import Arrivals, Queue, arrivals
from jaxdem.setup.bodies import Bodies, joined
from jaxdem.setup.bonds import BondList, bond_list, stored_bonds
from jaxdem.setup.free_space import free_space
from jaxdem.setup.packs import PackSetup
from jaxdem.setup.particles import ParticleSetup
from jaxdem.setup.regions import region_space
from jaxdem.setup.start_point import StartPoint


@dataclasses.dataclass(frozen=True)
class StartedParticles(ParticleSetup):
    """The particles of a scene with `[start]`.

    Their rows: those of the run, then those added, then those that inlets have yet to bring. So a particle keeps its
    number, and a row is never used twice.

    Attributes:
        start: state of that run, with its particles merged where the scene has larger parcels.
        settings: the table `[start]`.
        merge: what the merge took, see `jaxdem.setup.merge`; {} without.
    """

    start: StartPoint
    settings: Start
    merge: Mapping[str, object] = dataclasses.field(default_factory=dict)

    @property
    def is_started(self) -> bool:
        """See `ParticleSetup`."""
        return True

    @property
    def placed(self) -> int:
        """Number of rows of the run."""
        return len(self.start.arrays["state.particles.position"])

    @property
    def packs(self) -> tuple[PackSetup, ...]:  # type: ignore[override]
        """None: where the particles were at the very first start does not count any more."""
        return ()

    @property
    def count(self) -> int:
        """Number of rows at the start."""
        return self.placed + (0 if self.added is None else self.added.count)

    @cached_property
    def added(self) -> ParticleSetup | None:
        """The particles of `start.add`, laid out.

        Raises:
            InputError: as of the particles of a scene, with the keys of `start.add`.
        """
        table = self.settings.add
        if table is None:
            return None
        found = ParticleSetup(self.scene, table, self.contact)
        with keys_of_added():
            _ = found.position, found.present
        return found

    @cached_property
    def present(self) -> Bodies:
        """What the rows at the start are; see `ParticleSetup`."""
        before = self.start.bodies
        before = before._replace(material=self._renumbered(before.material))
        if len(np.broadcast_shapes(*(column.shape for column in before))):
            before = Bodies(*(column if column.ndim == 0 else column[: self.placed] for column in before))
        if self.added is None:
            return before
        groups = ((before, self.placed), (self.added.present, self.added.count))
        return joined([Bodies(*(np.broadcast_to(c, count) for c in group)) for group, count in groups])

    def _renumbered(self, material: np.ndarray) -> np.ndarray:
        """Numbers of the materials in this scene; by name where it has several."""
        before = [table["name"] for table in self.start.tables.get("materials", ())]
        names = [one.name for one in self.scene.materials]
        if not names:
            return np.asarray(0, np.int32)
        if not before:
            limit = f"the particles of the run {self.start.source} have no material"
            raise InputError("materials", number_of_tables(names), limit, "remove [[materials]]")
        for number in np.unique(material):
            if before[int(number)] not in names:
                limit = f"the run {self.start.source} has particles of {before[int(number)]!r}, which is not among them"
                raise InputError("materials", ", ".join(names), limit, "add it to [[materials]]")
        order = [names.index(name) if name in names else 0 for name in before]
        return np.asarray(order, np.int32)[material]

    @cached_property
    def active(self) -> np.ndarray:
        """(N,) bool, which of the rows at the start are present.

        Raises:
            InputError: some are not, and the scene says that all are.
        """
        before = self.start.arrays.get("state.particles.active")
        active = np.ones(self.count, bool)
        if before is not None:
            active[: self.placed] = before
        active[self.removed] = False
        if not self.scene.comes_and_goes and not active.all():
            limit = f"{np.count_nonzero(~active)} particles of the run {self.start.source} are gone or still to come"
            raise InputError("start.absent", False, limit, "remove this key")
        return active

    @cached_property
    def removed(self) -> np.ndarray:
        """Rows of the particles that are removed at the start."""
        before = self._at_first[: self.placed]
        gone = np.zeros(self.placed, bool)
        for k, region in enumerate(self.settings.remove):
            inside = region_space(f"start.remove.{k}", region, self.scene.box).inside(self._inside(before))
            gone |= inside
        there = self.start.arrays.get("state.particles.active")
        return np.flatnonzero(gone if there is None else gone & there)

    @cached_property
    def _at_first(self) -> np.ndarray:
        """(N, D) centres before any is moved [m]."""
        arrays = self.start.arrays
        centre = arrays["state.particles.position"].astype(np.float64)
        low = arrays.get("state.particles.position_low")
        centre = centre if low is None else centre + low
        size, _ = self.start.box
        changed = self.rewrapped
        if any(changed):
            centre = np.where(changed, into_period(centre, size), centre)
        return centre if self.added is None else np.concatenate([centre, self.added.position])

    @property
    def rewrapped(self) -> tuple[bool, ...]:
        """Axes that were periodic and are so no more, or with another length: centres are brought into the box."""
        size, periodic = self.start.box
        here = zip(size, periodic, self.scene.domain.size, self.scene.periodic, strict=True)
        return tuple(before and not (now and length == other) for length, before, other, now in here)

    @property
    def same_box(self) -> bool:
        """Whether box and periodic axes are those of the run."""
        size, periodic = self.start.box
        return tuple(size) == self.scene.domain.size and periodic == self.scene.periodic

    @cached_property
    def position(self) -> np.ndarray:
        """(N, D) centres at the start [m]; not yet checked against each other."""
        if not self.settings.relax:
            return self._at_first
        rows, radius = np.flatnonzero(self.active), np.broadcast_to(self.present.radius, self.count)
        whole, moved = free_space(self.scene, float(self.start.time)), self._at_first.copy()
        moved[rows], clear = moved_apart(whole, moved[rows], radius[rows])
        if not clear:
            limit = "some particles still overlap; there is no room to move them apart"
            raise InputError("start.relax", True, limit, "remove some by start.remove, or enlarge the box")
        return moved

    @cached_property
    def bonds(self) -> BondList | None:
        """Those of the run that it begins from; new ones where that had none.

        Raises:
            InputError: they cannot go on.
        """
        stored = stored_bonds(self.scene, self.start.arrays, self.removed, self.start.source)
        if stored is not None and self.settings.relax:
            limit = f"would strain the bonds of the run {self.start.source}"
            raise InputError("start.relax", True, limit, "remove this key")
        if stored is not None or not self.scene.bonds:
            return stored
        return bond_list(self.scene, self.position, self.present.radius, self.active, self.start.foreseen)

    @property
    def start_figures(self) -> dict[str, object]:
        """Numbers of particles removed, added and lost in a queue, and how far one was moved at most [m]."""
        added = 0 if self.added is None else self.added.count
        figures: dict[str, object] = {"removed": len(self.removed), "added": added}
        if self.merge:
            figures["merged"] = dict(self.merge)
        if self.settings.relax:
            figures["largest_move"] = self.largest_move
        return figures | ({"never_inserted": self.never} if self.never else {})

    @cached_property
    def largest_move(self) -> float:
        """How far `start.relax` has moved a particle at most [m]."""
        apart = self.position - self._at_first
        size = np.asarray(self.scene.domain.size)
        apart = np.where(self.scene.periodic, apart - size * np.round(apart / size), apart)
        return float(np.linalg.norm(apart[self.active], axis=1).max(initial=0.0))

    def _inside(self, position: np.ndarray) -> np.ndarray:
        """Centres in the box along periodic axes."""
        return np.where(self.scene.periodic, into_period(position, np.asarray(self.scene.domain.size)), position)

    @cached_property
    def _all_arrivals(self) -> tuple[Arrivals, ...]:
        """The particles of every inlet from t = 0 on."""
        return arrivals(self.scene, self.table)

    @cached_property
    def _goes_on(self) -> tuple[bool, ...]:
        """Which inlets bring the very particles that they brought in the run: they go on as they were."""
        before, queues, found = self.start.bodies, self.start.queues, []
        before = before._replace(material=self._renumbered(before.material))
        bodies = [np.broadcast_to(column, self.placed) for column in before]
        for k, whole in enumerate(self._all_arrivals):
            same = k < len(queues) and len(queues[k].time) <= len(whole.time)
            if same:
                rows, many = queues[k].rows, len(queues[k].time)
                pairs = zip(whole.bodies, bodies, strict=True)
                same = np.array_equal(whole.time[:many], queues[k].time)
                same = same and all(np.array_equal(ours[:many], theirs[rows]) for ours, theirs in pairs)
            found.append(same)
        return tuple(found)

    @cached_property
    def arrivals(self) -> tuple[Arrivals, ...]:
        """The particles of every inlet that have no row yet."""
        found, begin = [], float(self.start.time)
        for k, (whole, goes_on) in enumerate(zip(self._all_arrivals, self._goes_on, strict=True)):
            if goes_on:
                new = np.arange(len(whole.time)) >= len(self.start.queues[k].time)
            else:
                new = whole.time > begin
                if not new.any():
                    limit = f"brings no particle after the start at {begin:.9g} s"
                    raise InputError(f"particles.inlet.{k}", "...", limit, "remove it, or move its begin and end")
            found.append(Arrivals(whole.time[new], Bodies(*(column[new] for column in whole.bodies))))
        return tuple(found)

    @property
    def queues(self) -> tuple[Queue, ...]:
        """See `ParticleSetup`; an inlet that goes on has first the rows that it had."""
        found = []
        for k, queue in enumerate(super().queues):
            if self._goes_on[k]:
                before = self.start.queues[k]
                rows, time = np.concatenate([before.rows, queue.rows]), np.concatenate([before.time, queue.time])
                queue = Queue(rows.astype(np.int64), time, before.inserted)
            found.append(queue)
        return tuple(found)

    @property
    def never(self) -> int:
        """See `ParticleSetup`: those who were waiting at an inlet that does not go on."""
        goes_on = dict(enumerate(self._goes_on))
        return sum(len(q.rows) - q.inserted for k, q in enumerate(self.start.queues) if not goes_on.get(k, False))
