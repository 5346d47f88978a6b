"""What notebooks show: pictures with the right side in front, and gates in words."""

import base64
import re
import struct
import zlib

import numpy as np
import pytest
import viscera
from conftest import cube, falling
from viscera import pictures


def pixels_of(shown):
    """The picture of what _repr_html_ gives: [rows, columns, 3]."""
    data = base64.b64decode(re.search(r"base64,([^']+)'", shown).group(1))
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    columns, rows = struct.unpack(">II", data[16:24])
    at, packed = 8, b""
    while at < len(data):
        size, kind = struct.unpack(">I4s", data[at:at + 8])
        content = data[at + 8:at + 8 + size]
        assert zlib.crc32(kind + content) == struct.unpack(">I", data[at + 8 + size:at + 12 + size])[0]
        packed += content if kind == b"IDAT" else b""
        at += 12 + size
    lines = np.frombuffer(zlib.decompress(packed), np.uint8).reshape(rows, 1 + 3 * columns)
    return lines[:, 1:].reshape(rows, columns, 3)


def halves(axis):
    """A cube whose tets beyond its middle along an axis have label 2."""
    points, tets = cube(cells=4)
    beyond = points[tets].mean(axis=1)[:, axis] > 25.0
    return viscera.TetMesh(points, tets, 1 + beyond.astype(int), names={1: "liver", 2: "tumour"})


def test_a_mesh_is_seen_from_in_front_and_upright():
    one, two = (pictures.color_of(np.array([label]))[0].astype(np.uint8) for label in (1, 2))
    image = pixels_of(halves(axis=0)._repr_html_())  # 2 is the patient's left: the viewer's right
    rows, columns, _ = image.shape
    assert (image[rows // 2, columns // 4] == one).all() and (image[rows // 2, 3 * columns // 4] == two).all()
    image = pixels_of(halves(axis=2)._repr_html_())  # superior
    assert (image[rows // 4, columns // 2] == two).all() and (image[3 * rows // 4, columns // 2] == one).all()
    image = pixels_of(halves(axis=1)._repr_html_())  # posterior: hidden
    assert (image.reshape(-1, 3) == one).all(axis=1).all()


def test_a_picture_has_no_holes_whatever_the_size_of_its_triangles():
    for cells in (1, 3, 9):
        image = pixels_of(viscera.TetMesh(*cube(cells))._repr_html_())
        assert max(image.shape) == pictures.SIZE
        assert not (image.reshape(-1, 3) == pictures.PAPER).all(axis=1).any()


def test_the_boundary_of_a_cube_is_its_faces_seen_from_outside():
    points, tets = cube(cells=2, edge=2.0)
    faces, _ = pictures.boundary(tets, np.ones(len(tets), np.int32))
    corners = points[faces]
    normals = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(24.0)
    assert ((corners.mean(axis=1) - 1.0) * normals).sum() == pytest.approx(24.0)


def test_gates_that_failed_are_told_with_meaning_and_remedy_and_names_are_no_markup():
    k, j, i = np.ogrid[:24, :24, :24]
    ball = ((k - 12) ** 2 + (j - 12) ** 2 + (i - 12) ** 2 < 81).astype(np.uint8)
    labels = viscera.read_labels(ball, (2.0, 2.0, 2.0), names={1: "<b>lung</b>"})
    assert "<b>lung" not in labels._repr_html_() and "&lt;b&gt;lung" in labels._repr_html_()
    assert "1 gate passed" in labels._repr_html_()
    failing = labels.tet_mesh(cell_size="20 mm", max_volume_error=0.0)
    told = failing._repr_html_()
    assert "volume_error failed" in told and "Remedy: " in told
    assert "<b>lung" not in told
    cut = viscera.read_labels(np.ones((9, 9, 9), np.uint8), (2.0, 2.0, 2.0), border="accept")
    assert "<p><b>" in cut._repr_html_()  # its caveat comes first


def test_all_that_is_made_shows_itself():
    k, j, i = np.ogrid[:24, :24, :24]
    ball = ((k - 12) ** 2 + (j - 12) ** 2 + (i - 12) ** 2 < 81).astype(np.uint8)
    labels = viscera.read_labels(ball, (2.0, 2.0, 3.0), names={1: "liver"})
    surface = labels.surface()
    mesh = surface.tet_mesh(cell_size="8 mm")
    sim = viscera.Simulation(mesh, falling())
    sim.step(2)
    for made in (labels, surface, mesh, sim):
        image = pixels_of(made._repr_html_())
        assert 0.2 < (image < pictures.PAPER).any(axis=2).mean() <= 1.0
    assert "t 0.033 s" in sim._repr_html_()
