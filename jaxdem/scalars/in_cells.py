"""What the cells of the fluid are to a scalar: their capacity, what part of them conducts, and surfaces within them."""

from __future__ import annotations

from collections.abc import Sequence

import jax.numpy as jnp
from jax import Array

from jaxdem.errors import required
from jaxdem.fluid.cut_cells import CutCells, OpeningParts
from jaxdem.fluid.cut_scalar import ScalarSurfaces, ScalarWalls, capacity_of
from jaxdem.fluid.grid import CellOrOne, Grid, divergence, sum_of
from jaxdem.fluid.scalar_transport import SideKind, Stream


def fluid_share(walls: ScalarWalls | None, cut: CutCells | None, void_fraction: CellOrOne) -> CellOrOne:
    """Capacity of the cells for a scalar, over that of as much fluid as a whole cell: the void fraction, between
    surfaces see `cut_scalar`, where cells without fluid have 1 [-]."""
    if walls is None or cut is None:
        return void_fraction
    return capacity_of(cut.open_cells, walls.lent, void_fraction)


def between_surfaces(
    stream: Stream,
    walls: ScalarWalls,
    cut: CutCells,
    kinds: tuple[SideKind, ...],
    given: tuple[Array, CellOrOne, Array, Array],
) -> Stream:
    """The stream between surfaces.

    Args:
        stream: as if nothing were cut.
        walls, cut: the surfaces.
        kinds: what passes each; static.
        given: diffusivity [m2/s]; its part that acts in the cells [-]; (S,) values of the surfaces [unit]; (S,) fluxes
            from them [unit m/s].
    """
    diffusivity, share, value, flux = given
    has_value, has_flux = (jnp.asarray([kind == which for kind in kinds]) for which in ("value", "flux"))
    nearest = cut.nearest_to_cells
    rate = jnp.where(has_value[nearest], diffusivity * share * walls.exchange, 0.0)
    supply = jnp.where(has_flux[nearest], flux[nearest] * walls.area, 0.0)
    surfaces = ScalarSurfaces(
        cut.open_faces, cut.open_cells, walls.lent, rate, value[nearest], supply, nearest, len(kinds)
    )
    return stream._replace(share=cut.opened(stream.share), surfaces=surfaces)


def through_openings(
    grid: Grid,
    stream: Stream,
    surfaces: ScalarSurfaces,
    openings: Sequence[OpeningParts],
    given: tuple[Sequence[Array | None], Array, Array],
) -> ScalarSurfaces:
    """The surfaces with what passes their openings: the volume by which continuity of the stream, div F = s - dg/dt,
    is open in the cells beside them. What comes into a cell of several openings has the mean of their values by the
    volumes that they bring there; beside an outlet only the difference passes.

    Args:
        grid: the grid.
        stream: over the interval.
        surfaces: without openings, which keep their place.
        openings: on them.
        given: value of what comes in through each, None of one that nothing does [unit], (K,) what came in through
            each [m3/s], and the length of the interval [s].
    """
    brought, inflow, duration = given
    flux = required(stream.flux, "flux of the fluid")
    growth = surfaces.open_cells * (stream.after - stream.before) / duration
    is_open = sum_of(part.supply for part in openings) > 0.0
    passing = jnp.where(is_open, divergence(grid, flux) + growth, 0.0)
    # The least speed is for those through which nothing came: by area then, which only rounding is multiplied by.
    least = jnp.sqrt(jnp.finfo(inflow.dtype).tiny)
    bringing = [
        (part.supply * (flow / jnp.where(part.area > 0.0, part.area, 1.0) + least), value)
        for part, flow, value in zip(openings, inflow, brought, strict=True)
        if value is not None
    ]
    supply = surfaces.supply
    if bringing:
        whole = sum_of(share for share, _ in bringing)
        value = sum_of(share * value for share, value in bringing) / jnp.where(whole > 0.0, whole, 1.0)
        supply = supply + jnp.maximum(passing, 0.0) * value
    return surfaces._replace(supply=supply, drain=jnp.maximum(-passing, 0.0))


def conducting(bed: str, void_fraction: CellOrOne) -> CellOrOne:
    """Part of the fluid's conductivity that acts at a void fraction.

    "kuipers": 1 - sqrt(1 - g), the part of a bed through which heat goes by the fluid alone.

    Source: J. A. M. Kuipers, W. Prins, W. P. M. van Swaaij, AIChE J. 38 (1992) 1079-1091, after P. Zehner, E. U.
    Schluender, Chem.-Ing.-Tech. 42 (1970) 933-941.
    """
    if bed == "open" or isinstance(void_fraction, float):
        return void_fraction
    return 1.0 - jnp.sqrt(jnp.maximum(1.0 - void_fraction, jnp.finfo(void_fraction.dtype).tiny))
