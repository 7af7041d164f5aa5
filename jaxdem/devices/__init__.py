"""Many devices: a box cut into slabs along one axis, one a device.

    simulation, parameters = jaxdem.build(scene, devices=4)
    state, neighbors = jaxdem.initial_state(scene, simulation, parameters)
    state, neighbors, diagnostics = simulation.step(parameters, state, neighbors)
    whole, contacts = jaxdem.devices.gathered(simulation, state, neighbors)

A distributed state is the usual `State`. Arrays of `particles` and `fluid`, of the list, and of `forces` and `places`
of the diagnostics have an axis of slabs in front, (B, ...), spread over the devices by `mesh.SLABS`; `step` and the
other diagnostics are the same everywhere. A slab has R rows: `particles.identity` (B, R) says which particle is in a
row, `particles.active` in which rows there is one. Parameters are those of one device, by identity; beside walls that
the fluid sees they are those of `build(scene, devices=...)`, with an axis of slabs in front of what belongs to cells.

- `divided(simulation, devices, position)`: what `build(devices=...)` does with a simulation.
- `distributed(simulation, parameters, state, neighbors)`: a state on one device, or what `gathered` gave, in slabs.
- `gathered(simulation, state, neighbors)`: the state on the host, row i of particle i, and what contacts keep, by the
  identity of both particles (`Contacts`). It goes back to `distributed`, on another number of devices too, or to
  `on_one_device`. Every process must call it.
- `enlarged(simulation, parameters, state, neighbors, failed)`: after a step that raised `overflow`: the state before
  it with more room, from the list after it. Then the step is repeated.
- `mesh.on_slabs(mesh, function, given, result)`: any function of one slab, such as a loop over many intervals of
  `jaxdem.step.step(simulation, ...)`, as one program over all devices. The specifications `mesh.STATE`, `mesh.SLABS`,
  `mesh.SAME` and `mesh.DIAGNOSTICS` say how its arguments and results are spread.
  `parameters.spread(parameters)` says it of parameters.
- `simulation.with_parts(parameters)`: parameters of one device as those of the slabs; `of_whole` is the way back.
- `counts(neighbors)`: particles, ghosts, migrations and moves of the cut planes.
- `SlabRoom.of(neighbors)`: rows, ghosts, travellers and pairs that there is room for.
"""

from jaxdem.devices.contacts import Contacts
from jaxdem.devices.distribution import distributed, enlarged
from jaxdem.devices.figures import Counts, counts
from jaxdem.devices.gathering import gathered, gathered_rows, gathered_state, on_one_device
from jaxdem.devices.rooms import SlabRoom
from jaxdem.devices.simulation import DividedSimulation, divided

__all__ = [
    "Contacts",
    "Counts",
    "DividedSimulation",
    "SlabRoom",
    "counts",
    "distributed",
    "divided",
    "enlarged",
    "gathered",
    "gathered_rows",
    "gathered_state",
    "on_one_device",
]
