"""Visual meshes for telemetry: read once through trimesh, thinned out, merged by colour, kept in a cache.

The cache is the folder ``meshes`` of ``vuca_nav.caches``: one sealed ``.npz`` a mesh, named by the hash of the file's
content and of how it was thinned, so that processes that start together cannot read a half-written file. A damaged
file is made again. Without a writable cache the meshes are converted each time.
"""

import hashlib
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from robots.bodies.assets import MissingAsset, asset
from robots.bodies.urdf import Urdf, Visual
from vuca_nav.caches import cache_folder, read_sealed, write_sealed
from vuca_nav.telemetry.interface import MeshPart
from vuca_nav.types import FloatArray

_FORMAT = "2"
"""Version of the thinning and of the file: it changes with them, so that old entries are not found."""
_CELL = 0.008
"""Distance below which vertices are merged [m]: TIAGo shrinks from 106,000 triangles to 25,000 and looks the same."""


def load_mesh(file: Path, cell: float = _CELL) -> tuple[FloatArray, NDArray[np.int64]]:
    """Load vertices (n, 3) [m] and triangles (m, 3) of an STL or DAE file, thinned out on a grid of ``cell`` metres.

    Raises:
        MissingAsset: If the file cannot be read as a mesh.
    """
    content = file.read_bytes()
    key = hashlib.sha256(content + f"{_FORMAT} {cell} {file.suffix}".encode()).hexdigest()[:32]
    folder = cache_folder("meshes")
    packed = None if folder is None else read_sealed(folder / f"{key}.npz")
    if packed is not None:
        with np.load(io.BytesIO(packed), allow_pickle=False) as arrays:
            return arrays["vertices"], arrays["faces"]
    try:
        mesh = trimesh.load(file, force="mesh")
    except Exception as error:  # trimesh lets every parser's own errors through
        raise MissingAsset(f"{file} cannot be read as a mesh: {error}") from error
    vertices, faces = np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)  # type: ignore[attr-defined]
    if len(faces) == 0:
        raise MissingAsset(f"{file} holds no triangles")
    vertices, faces = _thinned(vertices, faces, cell)
    if folder is not None:
        archive = io.BytesIO()
        np.savez_compressed(archive, vertices=vertices, faces=faces)
        write_sealed(folder / f"{key}.npz", archive.getvalue())
    return vertices, faces


def merged_parts(
    urdf: Urdf, body_of_link: Mapping[str, str], positions: Mapping[str, float]
) -> list[tuple[str, MeshPart]]:
    """Merge the visuals of a robot into few parts: one for each body and colour.

    Args:
        urdf: The description.
        body_of_link: For each link to be shown, the link whose body it was fused into.
        positions: Joint positions of the fused joints [rad or m].

    Returns:
        Pairs of the body's link and a part in that link's frame, in a fixed order.
    """
    pieces: dict[tuple[str, tuple[int, int, int]], list[tuple[FloatArray, NDArray[np.int64]]]] = {}
    for link, body in body_of_link.items():
        body_from_link = urdf.transform(body, link, positions)
        for visual in urdf.links[link].visuals:
            vertices, faces = _geometry(visual)
            transform = body_from_link @ visual.link_from_visual
            red, green, blue = (round(255 * channel) for channel in visual.colour)
            vertices = vertices @ transform[:3, :3].T + transform[:3, 3]
            pieces.setdefault((body, (red, green, blue)), []).append((vertices, faces))
    parts = []
    for (body, colour), meshes in sorted(pieces.items()):
        vertices, faces = _concatenated(meshes)
        name = f"{body}_{colour[0]:02x}{colour[1]:02x}{colour[2]:02x}"
        parts.append((body, MeshPart(name, vertices.astype(np.float32), faces.astype(np.uint32), colour)))
    return parts


def _geometry(visual: Visual) -> tuple[FloatArray, NDArray[np.int64]]:
    match visual.kind:
        case "mesh":
            vertices, faces = load_mesh(asset(visual.mesh))
            return vertices * np.array(visual.size), faces
        case "box":
            mesh = trimesh.creation.box(visual.size)
        case "cylinder":
            mesh = trimesh.creation.cylinder(radius=visual.size[0], height=visual.size[1], sections=24)
        case _:
            mesh = trimesh.creation.icosphere(subdivisions=2, radius=visual.size[0])
    return np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64)


def _thinned(vertices: FloatArray, faces: NDArray[np.int64], cell: float) -> tuple[FloatArray, NDArray[np.int64]]:
    """Thin out by vertex clustering (Rossignac and Borrel 1993): a cell's vertices become their mean."""
    keys = np.floor(vertices / cell).astype(np.int64)
    _, cluster, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    cluster = cluster.reshape(-1)
    means = np.zeros((len(counts), 3))
    np.add.at(means, cluster, vertices)
    means /= counts[:, None]
    thinned = cluster[faces]
    a, b, c = thinned.T
    thinned = thinned[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(np.sort(thinned, axis=1), axis=0, return_index=True)
    thinned = thinned[np.sort(first)]
    used, thinned = np.unique(thinned, return_inverse=True)
    return means[used], thinned.reshape(-1, 3)


def _concatenated(
    meshes: Iterable[tuple[FloatArray, NDArray[np.int64]]],
) -> tuple[FloatArray, NDArray[np.int64]]:
    all_vertices, all_faces, offset = [], [], 0
    for vertices, faces in meshes:
        all_vertices.append(vertices)
        all_faces.append(faces + offset)
        offset += len(vertices)
    return np.concatenate(all_vertices), np.concatenate(all_faces)
