"""Weights of clumps: a body is spread over the cells by its members, each with its part of the volume of the union."""

from __future__ import annotations

import jax.numpy as jnp
from jax import Array

from jaxdem.coupling.deposition import Deposition
from jaxdem.coupling.interpolation import Weights
from jaxdem.fluid.grid import Grid
from jaxdem.numerics import vectors
from jaxdem.particles.clump_shape import Clumps
from jaxdem.particles.clumps import turned_by
from jaxdem.particles.integrate import ParticleProperties, ParticleState


def body_weights(
    deposition: Deposition, grid: Grid, particles: ParticleState, centres: Array, bodies: ParticleProperties
) -> Weights:
    """Weights of particles on the cells; each row adds up to one, so that the volume of the union is deposited.

    Args:
        deposition: of spheres.
        grid: of the fluid.
        particles: their orientations.
        centres: (N, D) of mass, in the box [m].
        bodies: radius; of clumps their members too.
    """
    clumps = bodies.clumps
    if clumps is None:
        return deposition.weights(grid, centres, bodies.radius)
    count, members = centres.shape[0], clumps.members
    places = tuple(
        (x[None] + a).reshape(-1) for x, a in zip(vectors.components(centres), arms(particles, clumps), strict=True)
    )
    radius = clumps.rows(jnp.asarray(clumps.radius), count)
    weights = deposition.weights(grid, jnp.stack(places, axis=1), radius)
    share = jnp.broadcast_to(clumps.share, (members, count)).reshape(-1, 1)

    def of_bodies(rows: Array) -> Array:
        return jnp.moveaxis(rows.reshape(members, count, -1), 0, 1).reshape(count, -1)

    rows = of_bodies(weights.index), of_bodies(weights.weight * share)
    return weights._replace(index=rows[0], weight=rows[1], along_axes=None)


def arms(particles: ParticleState, clumps: Clumps) -> tuple[Array, ...]:
    """D arrays (m, N), from the centres of mass to the members [m]."""
    assert particles.orientation is not None
    turning = tuple(part[None] for part in vectors.components(jnp.asarray(particles.orientation)))
    offset = tuple(jnp.asarray(x) for x in clumps.offset)
    if len(turning) == 1:
        cosine, sine = jnp.cos(turning[0]), jnp.sin(turning[0])
        return cosine * offset[0] - sine * offset[1], sine * offset[0] + cosine * offset[1]
    return turned_by(turning, offset)


def crosswise_sphericity(particles: ParticleState, clumps: Clumps, slip: Array) -> Array:
    """(N,) pi r^2 over the area of the projection along the slip (N, D); at no slip along the first axis [-].

    The area is exact along the principal axes; between them sqrt(sum_k (A_k n_k)^2), n the slip's direction in the
    body, which is that of an ellipsoid.
    """
    assert particles.orientation is not None
    turning = vectors.components(particles.orientation)
    flow = vectors.components(slip)
    along: tuple[Array, ...]
    if len(turning) == 1:
        cosine, sine = jnp.cos(turning[0]), jnp.sin(turning[0])
        along = (cosine * flow[0] + sine * flow[1], cosine * flow[1] - sine * flow[0])
    else:
        along = turned_by((-turning[0], *turning[1:]), flow)
    squared = vectors.dot(along, along)
    moves = squared > 0.0
    part = [jnp.where(moves, x**2 / jnp.where(moves, squared, 1.0), float(k == 0)) for k, x in enumerate(along)]
    area = sum((shadow**2 * n for shadow, n in zip(clumps.shadow, part, strict=True)), jnp.zeros_like(squared))
    return 1.0 / jnp.sqrt(area)
