"""How notebooks show labels, meshes and simulations: a picture, a few figures, and the gates."""

import base64
import html
import struct
import zlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from . import Simulation
    from ._preparation import Labels, Surface
    from ._viscera import TetMesh

Rgb = NDArray[np.uint8]
Points = NDArray[np.float64]
Faces = NDArray[np.int32]

# Okabe and Ito's colours, which differ for most colour-blind readers.
COLORS = np.array([[204, 121, 107], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178],
                   [213, 94, 0], [204, 121, 167]], np.float64)
PAPER = 255
SIZE = 320  # pixels of the longer side of a body
CLOSE = 0.7  # pixels between the points of a triangle


def color_of(label: NDArray[np.int32]) -> Points:
    colors: Points = COLORS[(np.asarray(label) - 1) % len(COLORS)]
    return colors


def png(pixels: Rgb) -> bytes:
    """An image [rows, columns, 3] as a PNG file."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    rows, columns, _ = pixels.shape
    lines = b"".join(b"\0" + row.tobytes() for row in np.ascontiguousarray(pixels, np.uint8))
    header = struct.pack(">IIBBBBB", columns, rows, 8, 2, 0, 0, 0)
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines, 6))
            + chunk(b"IEND", b""))


def boundary(tets: Faces, labels: Faces) -> tuple[Faces, Faces]:
    """The faces that one tet alone has, seen from outside, and the label of each."""
    corners = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
    faces: Faces = tets[:, corners].reshape(-1, 3)
    _, index, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    alone = np.sort(index[count == 1])
    return faces[alone], labels[alone // 4]


def drawn(points: Points, faces: Faces, colors: Points) -> Rgb:
    """Triangles in the light of the viewer, who stands anterior of the patient and sees it upright."""
    across, up, away = points[:, 0], points[:, 2], points[:, 1]  # LPS: x to the patient's left
    scale = (SIZE - 1) / max(float(np.ptp(across)), float(np.ptp(up)), 1e-12)
    at = np.stack([(across - across.min()) * scale, (up.max() - up) * scale, away], axis=1)
    corners = points[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    facing = -normals[:, 1] / np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    seen = np.flatnonzero(facing > 0.0)
    shades = ((0.35 + 0.65 * facing[seen, None]) * colors[seen]).astype(np.uint8)
    corners = at[faces[seen]]
    edges = corners - np.roll(corners, 1, axis=1)
    longest = np.linalg.norm(edges[:, :, :2], axis=2).max(axis=1, initial=0.0)
    # Each as points closer than pixels, those of one density together.
    density = 2 ** np.ceil(np.log2(np.maximum(longest / CLOSE, 1.0))).astype(int)
    places, whose = [], []
    for k in np.unique(density):
        v, w = (index.ravel() for index in np.mgrid[: k + 1, : k + 1])
        weights = np.stack([k - v - w, v, w], axis=1)[v + w <= k] / k
        those = np.flatnonzero(density == k)
        places.append(np.einsum("pc,tcx->tpx", weights, corners[those]).reshape(-1, 3))
        whose.append(np.repeat(those, len(weights)))
    image = np.full((int(at[:, 1].max()) + 1, int(at[:, 0].max()) + 1, 3), PAPER, np.uint8)
    if not places:
        return image
    place, triangle = np.concatenate(places), np.concatenate(whose)
    order = np.argsort(-place[:, 2], kind="stable")  # the nearest last, which stays
    column, row = place[order, 0].astype(int), place[order, 1].astype(int)
    image[row, column] = shades[triangle[order]]
    return image


def slices(voxels: NDArray[np.uint16], spacing: list[float]) -> Rgb:
    """The middle planes across each axis of a volume, side by side, in proportion."""
    planes = []
    for axis in range(3):
        others = [a for a in range(3) if a != axis]
        filled = np.flatnonzero(voxels.any(axis=tuple(others)))
        plane: NDArray[np.uint16] = np.take(voxels, int(filled[len(filled) // 2]), axis=axis)
        mm = [spacing[2 - a] * voxels.shape[a] for a in others]
        shape = [max(1, round(0.6 * SIZE * length / max(mm))) for length in mm]
        rows, columns = (np.arange(n) * plane.shape[a] // n for a, n in enumerate(shape))
        scaled = plane[np.ix_(rows, columns)].astype(np.int32)
        image = np.where(scaled[:, :, None] > 0, color_of(scaled), 240).astype(np.uint8)
        planes.append(image[::-1] if axis > 0 else image)  # the last plane of the first axis is up
    height = max(plane.shape[0] for plane in planes)
    padded = [np.pad(plane, ((0, height - plane.shape[0]), (0, 8), (0, 0)), constant_values=PAPER)
              for plane in planes]
    return np.concatenate(padded, axis=1)


def told(gates: Iterable[Mapping[str, Any]]) -> str:
    """Gates that failed with what that means; the others are counted, and listed for those who ask."""
    passed, failed = [], []
    for gate in gates:
        unit = "" if gate["unit"] == "1" else f" {gate['unit']}"
        name, found, required = (html.escape(text) for text in (
            str(gate["name"]), f"{gate['value']:.4g}{unit}", f"{gate['comparison']} {gate['limit']:.4g}{unit}"))
        if gate["passed"]:
            passed.append(f"<tr><td>{name}</td><td>{found}</td><td>{required}</td></tr>")
        else:
            failed.append(f"<p><b>{name} failed: {found}, required {required}.</b> {html.escape(gate['meaning'])} "
                          f"Remedy: {html.escape(gate['remedy'])}.</p>")
    listed = (f"<details><summary>{len(passed)} {'gate' if len(passed) == 1 else 'gates'} passed</summary><table><tr><th>gate</th><th>value</th>"
              f"<th>required</th></tr>{''.join(passed)}</table></details>") if passed else ""
    return "".join(failed) + listed


def shown(title: str, image: Rgb, gates: Iterable[Mapping[str, Any]] = (), caveats: Iterable[str] = ()) -> str:
    data = base64.b64encode(png(image)).decode()
    first = "".join(f"<p><b>{html.escape(caveat)}</b></p>" for caveat in caveats)
    return (f"<div>{first}<p>{html.escape(title)}</p><img alt='{html.escape(title, quote=True)}' "
            f"src='data:image/png;base64,{data}'><br>{told(gates)}</div>")


def materials(names: Mapping[int, str]) -> str:
    return ", ".join(name for id, name in sorted(names.items()) if id > 0)


def of_labels(labels: "Labels") -> str:
    k, j, i = labels.voxels.shape
    title = f"{materials(labels.names)}: {i} × {j} × {k} voxels of {' × '.join(f'{s:.3g}' for s in labels.spacing)} mm"
    return shown(title, slices(labels.voxels, labels.spacing), labels.gates, labels.caveats)


def of_surface(surface: "Surface") -> str:
    faces, labels = surface.triangles, surface.labels
    outer = labels == 0 if (labels == 0).any() else labels > 0
    image = drawn(surface.points, faces[outer], color_of(np.maximum(labels[outer], 1)))
    title = f"{materials(surface.names)}: {len(faces):,} triangles"
    return shown(title, image, surface.gates, surface.caveats)


def of_mesh(mesh: "TetMesh") -> str:
    faces, labels = boundary(mesh.tets, mesh.labels)
    title = f"{materials(mesh.names)}: {len(mesh.tets):,} tets, {len(mesh.points):,} vertices"
    return shown(title, drawn(mesh.points, faces, color_of(labels)), mesh.gates, mesh.caveats)


def of_simulation(simulation: "Simulation") -> str:
    now = simulation.diagnose()
    faces, labels = boundary(simulation.mesh.tets, simulation.mesh.labels)
    title = (f"t {simulation.time:.3f} s: volume {100.0 * now['volume_ratio']:.2f} % of that at rest, fastest vertex "
             f"{1e3 * now['max_speed_m_s']:.3g} mm/s, {now['inverted']} tets inside out; on {simulation.device}")
    first = [off_by(simulation.certified)] if simulation.certified else []
    return shown(title, drawn(simulation.positions, faces, color_of(labels)), simulation.gates,
                 [*first, *simulation.caveats])


def off_by(error: Mapping[str, Any]) -> str:
    """How far a certified body is off, by its parts."""
    parts = ", ".join(f"{name} {error[name]:.2g}" for name in ("solver", "element", "mesh", "support", "surface")
                      if error[name] is not None)
    return f"At rest {error['total']:.2g} mm off, {100 * error['share']:.2g} % of the displacement: {parts} mm"
