"""A region with walls in it: surfaces that particles must not reach into. Host; the surfaces are evaluated by JAX."""

from __future__ import annotations

import jax
import numpy as np

from jaxdem.numerics.static import static
from jaxdem.particles.regions import Region
from jaxdem.particles.surfaces import Surface, surface_contacts


@static
class WalledRegion(Region):
    """The part of a region that lies before all of some walls.

    Attributes:
        surfaces: the walls.
    """

    surfaces: tuple[Surface, ...] = ()

    def signed_distance(self, points: np.ndarray) -> np.ndarray:
        """See `Region`; the largest of the distances behind the walls and out of the region."""
        behind, _ = self._contacts(points, np.zeros(len(points)))
        return np.maximum(super().signed_distance(points), behind.max(axis=0))

    def kept(self, points: np.ndarray, margin: float | np.ndarray) -> np.ndarray:
        """See `Region`; then out of every wall along its normal."""
        margin = np.broadcast_to(margin, len(points))
        moved = super().kept(points, margin)
        overlap, normal = self._contacts(moved, margin)
        return moved + np.einsum("sn,sna->na", np.maximum(overlap, 0.0), normal)

    def _contacts(self, points: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(S, N) how far spheres reach into the walls [m], and (S, N, D) the normals there."""
        if not len(points):
            return np.zeros((len(self.surfaces), 0)), np.zeros((len(self.surfaces), 0, self.dimension))
        # As many as a power of two: one program for all numbers up to it.
        rows = np.resize(np.arange(len(points)), 1 << max(len(points) - 1, 0).bit_length())
        # Leading and trailing parts, as the contacts see them in float32.
        dtype = jax.dtypes.canonicalize_dtype(np.float64)
        leading = points[rows].astype(dtype)
        low = (points[rows] - leading).astype(dtype)
        overlap, normal = _contacts(self.surfaces, tuple(leading.T), tuple(low.T), radius[rows].astype(dtype))
        return np.asarray(overlap)[:, : len(points)], np.stack([np.asarray(n)[:, : len(points)] for n in normal], -1)


_contacts = jax.jit(surface_contacts, static_argnums=0)
