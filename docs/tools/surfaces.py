"""Writes the meshes of the scenes into scenes/: a silo, a ball, a drum with lifters, a slope.

python docs/tools/surfaces.py [--folder scenes]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import trimesh

sys.path.insert(0, str(Path(__file__).parents[2]))  # run as a script from anywhere

from tests.cases.surfaces import turned

DRUM, LIFTERS, LIFTER = 0.1, 8, (0.012, 0.006)
"""Radius of the drum, number of its lifters, their height and width [m]."""


def silo(radius: float, orifice: float, cone: float, height: float, sides: int = 72) -> trimesh.Trimesh:
    """A cylinder on a cone; its lip is at z = 0 [m]."""
    return turned(np.array([[orifice, 0.0], [radius, cone], [radius, height]]), sides)


def drum_with_lifters(length: float) -> trimesh.Trimesh:
    """A cylinder about the y axis with bars on its inside, open at both ends."""
    height, width = LIFTER
    half, points = np.arcsin(0.5 * width / DRUM), []
    for k in range(LIFTERS):
        middle = 2.0 * np.pi * k / LIFTERS
        for away, side in ((DRUM, -1), (DRUM - height, -1), (DRUM - height, 1), (DRUM, 1)):
            angle = middle + side * np.arcsin(0.5 * width / away)
            points.append(away * np.array([np.cos(angle), np.sin(angle)]))
        between = np.linspace(middle + half, middle + 2.0 * np.pi / LIFTERS - half, 7)[1:-1]
        points += [DRUM * np.array([np.cos(angle), np.sin(angle)]) for angle in between]
    ring, count = np.asarray(points), len(points)
    corners = np.concatenate([np.insert(ring, 1, y, axis=1) for y in (0.0, length)])
    k = np.arange(count)
    nxt = (k + 1) % count
    cells = [np.stack([k, nxt, nxt + count], 1), np.stack([k, nxt + count, k + count], 1)]
    return trimesh.Trimesh(corners, np.concatenate(cells))


def slope(spacing: float, size: tuple[float, float]) -> np.ndarray:
    """(X, Y) heights of a gully of 30 degrees that runs out on a plain [m]."""
    x, y = (spacing * np.arange(round(length / spacing) + 1) for length in size)
    down = np.tan(np.radians(30.0)) * np.maximum(0.62 - x, 0.0)
    # Smooth where the slope meets the plain, over 0.16 m.
    bend = np.clip((0.7 - x) / 0.16, 0.0, 1.0)
    height = np.where(bend < 1.0, 0.5 * np.tan(np.radians(30.0)) * 0.16 * bend**2, down)
    across = (y - 0.5 * size[1]) / (0.5 * size[1])
    rough = 0.004 * np.sin(40.0 * x)[:, None] * np.cos(31.0 * y + 1.0)[None]
    gully = 0.06 * across[None] ** 2 * np.clip((0.9 - x) / 0.3, 0.0, 1.0)[:, None]
    found: np.ndarray = 0.02 + height[:, None] + gully + rough
    return found


def main() -> None:
    """Writes all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--folder", type=Path, default=Path(__file__).parents[2] / "scenes")
    folder = parser.parse_args().folder
    meshes = {
        "dosta_silo_small": silo(0.1, 0.02, 0.08, 0.8),
        "dosta_silo_large": silo(0.1, 0.03, 0.07, 0.8),
        "dosta_ball": trimesh.creation.icosphere(subdivisions=3, radius=0.01),
        "drum_with_lifters": drum_with_lifters(0.05),
    }
    for name, mesh in meshes.items():
        (folder / f"{name}.stl").write_bytes(mesh.export(file_type="stl"))
        print(f"{name}.stl: {len(mesh.faces)} triangles")
    np.savetxt(folder / "slope.txt", slope(0.02, (1.4, 0.4)), fmt="%.4f")


if __name__ == "__main__":
    main()
