"""What `jaxdem check` says of the walls that are meshes."""

from __future__ import annotations

from jaxdem.setup.meshes import WallMesh


def mesh_rows(meshes: tuple[WallMesh, ...]) -> tuple[tuple[str, str], ...]:
    """Key and text of each mesh."""
    return tuple((mesh.key, _text(mesh)) for mesh in meshes)


def _text(mesh: WallMesh) -> str:
    lower, upper = mesh.mesh.bounds
    size = " x ".join(f"{length:.4g}" for length in upper - lower)
    flat = mesh.mesh.dimension == 2
    cells, found = ("lines" if flat else "triangles"), mesh.defects
    rims = "closed" if found.is_closed else f"open, {found.open_edges} {'ends' if flat else 'edges at holes and rims'}"
    features = mesh.features
    edges = "" if flat else f"{len(features.edges.patch)} edges and "
    text = f"{len(mesh.mesh.cells)} {cells}, {size} m, {rims}"
    text += f", {found.pieces} pieces" if found.pieces != 1 else ""
    if found.crowded_edges:
        text += f", {found.crowded_edges} {'points' if flat else 'edges'} where more than two {cells} meet"
    sides = "from both sides" if mesh.both else "from the front"
    return f"{text}; touched {sides}; {edges}{len(features.corners.patch)} corners stick out"
