"""Open parts of faces and cells against closed forms: planes, circles, cylinders and spheres."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxdem.solids.clipping import of_simplex, positive_part
from tests.cases.tiers import tiered


def mesh(cells, size=1.0):
    points = [np.linspace(0.0, size, n + 1) for n in cells]
    return np.meshgrid(*points, indexing="ij")


def test_a_cube_cut_by_a_plane_in_any_direction():
    # The part of a unit cube where n . x < d, n > 0: sum over corners c of (-1)^k (d - n . c)_+^3 / (6 n1 n2 n3).
    x = mesh((1, 1, 1))
    for normal in ([1.0, 2.0, 3.0], [0.1, 5.0, 0.3], [1.0, 1.0, 1.0]):
        n = np.asarray(normal) / np.linalg.norm(normal)
        for d in np.linspace(0.02, 0.98, 7) * n.sum():
            exact = 0.0
            for corner in np.ndindex(2, 2, 2):
                exact += (-1) ** sum(corner) * max(d - n @ corner, 0.0) ** 3 / (6.0 * n.prod())
            distance = d - sum(a * b for a, b in zip(n, x, strict=True))
            part = positive_part(distance, (0, 1, 2))
            assert part.fraction.item() == pytest.approx(exact, abs=1e-13)
            # The cut closes the open faces: its area times the normal is the difference of opposite faces.
            faces = [positive_part(distance, tuple({0, 1, 2} - {a})).fraction.reshape(-1) for a in range(3)]
            cut = np.array([f[0] - f[1] for f in faces])
            assert cut / np.linalg.norm(cut) == pytest.approx(n, abs=1e-12)
            # A thin slice: the volume grows by the area of the cut.
            grown = positive_part(distance + 1e-6, (0, 1, 2)).fraction.item()
            assert (grown - exact) / 1e-6 == pytest.approx(np.linalg.norm(cut), rel=1e-4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_volumes_of_round_bodies(dimension):
    errors = []
    for n in (8, 16, 32):
        x = mesh((n,) * dimension)
        distance = np.sqrt(sum((a - b) ** 2 for a, b in zip(x, (0.51, 0.48, 0.53), strict=False))) - 0.37
        part = positive_part(distance, tuple(range(dimension)))
        solid = 1.0 - part.fraction.mean()
        exact = np.pi * 0.37**2 if dimension == 2 else 4.0 / 3.0 * np.pi * 0.37**3
        errors.append(abs(solid / exact - 1.0))
        # The interpolant is off by at most D h^2/8 over the radius, and by that much the surface is shifted.
        assert errors[-1] < dimension * dimension / 8.0 * (1.0 / n / 0.37) ** 2
    assert np.log2(errors[0] / errors[-1]) / 2.0 > 1.8


def test_cylinder_along_an_axis_is_the_circle():
    x = mesh((9, 7, 3))
    distance = np.hypot(x[0] - 0.45, x[1] - 0.52) - 0.3
    circle = positive_part(distance[:, :, 0], (0, 1)).fraction
    cells = positive_part(distance, (0, 1, 2)).fraction
    across = positive_part(distance, (0, 1)).fraction
    assert across[:, :, 1] == pytest.approx(circle, abs=1e-15)
    # The interpolant in tetrahedra differs from that in triangles by its curvature alone.
    assert cells[:, :, 1] == pytest.approx(circle, abs=0.02)


def test_mean_distance_of_the_open_part_of_an_edge():
    part = of_simplex([np.array([3.0, -1.0, 2.0, -2.0]), np.array([-1.0, -2.0, 1.0, 0.0])])
    assert part.fraction == pytest.approx([0.75, 0.0, 1.0, 0.0])
    assert part.integral == pytest.approx([0.75 * 1.5, 0.0, 1.5, 0.0])


@pytest.mark.parametrize("dimension", tiered([2, 3], first=[2]))
def test_slopes_by_the_offset_of_a_plane_are_areas(dimension):
    axes = tuple(range(dimension))
    x = [jnp.asarray(a) for a in mesh((4,) * dimension)]
    n = np.array([0.3, -0.5, 0.81][-dimension:])
    n = n / np.linalg.norm(n)
    offset = {2: 0.08, 3: 0.31}[dimension]

    @jax.jit
    def volume(offset):
        distance = sum(a * b for a, b in zip(n, x, strict=True)) - offset
        return jnp.mean(positive_part(distance, axes).fraction)

    both = jax.jit(jax.value_and_grad(volume))
    value, slope = both(offset)
    step = 1e-5
    difference = float(volume(offset + step) - volume(offset - step)) / (2 * step)
    assert float(slope) == pytest.approx(difference, rel=1e-6) and slope < 0.0
    assert np.isfinite(both(5.0)[1])
    host = positive_part(sum(a * np.asarray(b) for a, b in zip(n, x, strict=True)) - offset, axes)
    assert float(value) == pytest.approx(host.fraction.mean(), rel=1e-13)
