"""From voxels to tets in memory, against the programs of the stages."""

import json
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pytest
import viscera
from conftest import ball, falling, read_nrrd, resident_kb

PHANTOM = pathlib.Path("sample_data/phantom.nrrd")
MATERIALS = {"liver": 1, "tumour": 2, "vessels": 3}


@pytest.fixture(scope="module")
def labels():
    return viscera.read_labels(PHANTOM, labels=MATERIALS)


def manifest_of(folder):
    return json.loads((folder / "manifest.json").read_text())


def gates_of(made):
    return [(gate["name"], gate["value"], gate["limit"], gate["passed"]) for gate in made.gates]


def gates_in(manifest):
    compare = {"<=": lambda a, b: a <= b, ">=": lambda a, b: a >= b}
    return [(gate["name"], gate["value"], gate["limit"], compare[gate["comparison"]](gate["value"], gate["limit"]))
            for gate in manifest["gates"]]


def metrics_in(manifest):
    return {metric["name"]: metric["value"] for metric in manifest["metrics"] if not metric.get("machine")}


def test_labels_are_those_of_the_program(demo, labels):
    voxels, spacing, origin, direction = read_nrrd(demo / "labels/labels.nrrd")
    np.testing.assert_array_equal(labels.voxels, voxels)
    np.testing.assert_allclose(labels.spacing, spacing, rtol=1e-12)
    np.testing.assert_allclose(labels.origin, origin, rtol=1e-12)
    np.testing.assert_allclose(labels.direction, direction, atol=1e-12)
    assert labels.names == {1: "liver", 2: "tumour", 3: "vessels"}
    manifest = manifest_of(demo / "labels")
    assert gates_of(labels) == gates_in(manifest)
    assert labels.metrics == metrics_in(manifest)


def test_an_array_gives_what_its_file_gives(labels):
    voxels, spacing, origin, direction = read_nrrd(PHANTOM)
    for given in [voxels, voxels.astype(np.int64), np.asfortranarray(voxels)]:
        made = viscera.read_labels(given, spacing, origin, direction, labels=MATERIALS)
        np.testing.assert_array_equal(made.voxels, labels.voxels)
        np.testing.assert_allclose(made.origin, labels.origin, rtol=1e-12)
        assert gates_of(made) == gates_of(labels)
    named = viscera.read_labels(voxels, spacing, names={1: "liver", 2: "tumour"})
    assert named.names == {1: "liver", 2: "tumour", 3: "label_3"}


def test_a_surface_has_the_measures_of_the_program(demo, labels):
    surface = labels.surface()
    manifest = manifest_of(demo / "surface")
    assert gates_of(surface) == gates_in(manifest)
    assert json.loads(json.dumps(surface.metrics)) == metrics_in(manifest)
    assert surface.names == {0: "body", 1: "liver", 2: "tumour", 3: "vessels"}
    assert surface.triangles.max() == len(surface.points) - 1
    assert len(surface.labels) == len(surface.triangles)


def test_a_mesh_has_the_bits_of_the_program(demo, labels):
    mesh = labels.tet_mesh(surface=labels.surface(), cell_size="14 mm")
    written = viscera.read_mesh(demo / "tetmesh/mesh.vtu")
    np.testing.assert_array_equal(mesh.points, written.points)
    np.testing.assert_array_equal(mesh.tets, written.tets)
    np.testing.assert_array_equal(mesh.labels, written.labels)
    assert mesh.names == written.names
    manifest = manifest_of(demo / "tetmesh")
    assert gates_of(mesh) == gates_in(manifest)
    assert json.loads(json.dumps(mesh.metrics)) == metrics_in(manifest)
    assert all(gate["passed"] for gate in mesh.gates)
    assert len(mesh.cell_data["volume"]) == len(mesh.tets)


def test_a_simulation_from_an_array_has_the_bits_of_one_from_the_file(demo, labels):
    scene = "configs/scenes/drop.yaml"
    sims = [viscera.Simulation(mesh, scene, substeps=16, threads=1)
            for mesh in (labels.tet_mesh(cell_size="14 mm"), viscera.read_mesh(demo / "tetmesh/mesh.vtu"))]
    for sim in sims:
        sim.step(3)
    assert sims[0].state_hash == sims[1].state_hash


def test_a_surface_alone_is_filled_with_tets_where_its_points_are(labels):
    surface = labels.surface(body=False)
    alone = surface.labels == 1
    used = np.unique(surface.triangles[alone])
    number = np.full(len(surface.points), -1)
    number[used] = np.arange(len(used))
    liver = viscera.Surface(surface.points[used], number[surface.triangles[alone]], names={1: "liver"})
    mesh = liver.tet_mesh(cell_size="16 mm")
    low, high = liver.points.min(axis=0), liver.points.max(axis=0)
    assert (mesh.points >= low - 1.6).all() and (mesh.points <= high + 1.6).all()
    assert mesh.names == {1: "liver"}


def test_a_region_of_a_mesh_is_what_a_scene_holds(labels):
    mesh = labels.tet_mesh(cell_size="16 mm", regions={"top": {"side": "superior", "within": "25 mm"}})
    inside = mesh.regions["top"]
    assert inside.dtype == bool
    held = np.unique(mesh.tets[inside])
    scene = json.loads(json.dumps(falling()))
    scene["materials"] |= {"tumour": scene["materials"]["liver"], "vessels": scene["materials"]["liver"]}
    scene["effects"]["fixed"] = {"region": "top"}
    sim = viscera.Simulation(mesh, scene)
    sim.step(5)
    moved = np.linalg.norm(sim.displacements, axis=1)
    assert moved[held].max() == 0.0
    assert moved.max() > 1e-4


def test_a_certified_body_says_how_far_it_is_off_and_where_its_next_mesh_is_to_be_fine(labels):
    regions = {"top": {"side": "superior", "within": "25 mm"}}
    mesh = labels.tet_mesh(cell_size="18 mm", regions=regions)
    scene = falling(fixed={"region": "top"})
    scene["materials"] |= {"tumour": scene["materials"]["liver"], "vessels": scene["materials"]["liver"]}
    scene["time"]["end"] = "4 s"
    scene["rest"] = {"speed": "2 mm/s", "hold": "0.1 s"}
    probe = {"tip": {"point": [f"{x} mm" for x in mesh.points[mesh.points[:, 2].argmin()]]}}
    sim = viscera.Simulation(mesh, scene, probes=probe, threads=1)
    assert sim.run()["rested"]
    error = sim.certify()
    assert 0.01 < error["share"] < 0.5
    assert max(error["element"], error["mesh"]) < error["total"]
    parts = ("solver", "element", "mesh", "support", "surface")
    assert error["total"] <= sum(error[part] for part in parts) * (1 + 1e-12)
    assert error["surface"] > 0, "the mesh says where the labels end"
    assert set(error["quantities"]) == {"liver", "tumour", "vessels", "tip"}
    sizes = error["size_field"].cell_data["relative_size"]
    assert sizes.shape == (len(mesh.tets),) and sizes.min() < 0.9 < 1.1 < sizes.max()

    def share_where_cells_are_to_be_small(tets, points):
        """Of the tets, those whose middle lies in the half of the old body that asks for the smallest cells."""
        fine = mesh.points[mesh.tets[sizes < np.median(sizes)]].mean(axis=1)
        coarse = mesh.points[mesh.tets[sizes >= np.median(sizes)]].mean(axis=1)
        middles = points[tets].mean(axis=1)
        return np.mean([((fine - p) ** 2).sum(axis=1).min() < ((coarse - p) ** 2).sum(axis=1).min()
                        for p in middles])

    wanted = 2 * len(mesh.tets)
    finer = labels.tet_mesh(size_field=error["size_field"], target_tets=wanted, regions=regions)
    assert len(finer.tets) == pytest.approx(wanted, rel=0.1)
    even = labels.tet_mesh(target_tets=wanted, regions=regions)
    assert (share_where_cells_are_to_be_small(finer.tets, finer.points)
            > share_where_cells_are_to_be_small(even.tets, even.points))
    with pytest.raises(viscera.Error, match="relative_size"):
        labels.tet_mesh(size_field=mesh, cell_size="18 mm")


def test_axes_and_places_are_those_of_simpleitk(monkeypatch):
    # A bar along x, away from the middle, on a turned grid.
    voxels = np.zeros((12, 14, 30), np.uint8)
    voxels[3:8, 4:10, 5:25] = 1
    turned = (0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)  # x of the grid is y of the patient

    class Image:
        def GetSpacing(self):
            return (2.0, 3.0, 4.0)

        def GetOrigin(self):
            return (10.0, 20.0, 30.0)

        def GetDirection(self):
            return turned

    # SimpleITK is not in Debian: this stands in for the calls that are made of it.
    monkeypatch.setitem(sys.modules, "SimpleITK",
                        types.SimpleNamespace(GetArrayViewFromImage=lambda image: voxels))
    labels = viscera.read_labels(Image(), names={1: "bar"})
    assert labels.direction == list(turned) and labels.spacing == [2.0, 3.0, 4.0]
    assert labels.voxels.shape[0] < labels.voxels.shape[2]
    assert (labels.voxels > 0).sum() == (voxels > 0).sum()
    surface = labels.surface()
    middle = 0.5 * (surface.points.min(axis=0) + surface.points.max(axis=0))
    i, j, k = 2.0 * 14.5, 3.0 * 6.5, 4.0 * 5.0
    np.testing.assert_allclose(middle, [10.0 - j, 20.0 + i, 30.0 + k], atol=0.5)


def test_arrays_that_are_no_labels_are_refused():
    one = (1.0, 1.0, 1.0)
    wrong = [
        (TypeError, "whole numbers", ball().astype(float), one),
        (TypeError, "whole numbers", np.full((4, 4, 4), np.nan), one),
        (TypeError, "whole numbers", np.array([["a"]]), one),
        (ValueError, r"shape \(20, 20\)", ball()[0], one),
        (ValueError, "-1", -ball().astype(int), one),
        (ValueError, "65536", ball().astype(int) * 65536, one),
        (ValueError, "18446744073709551615", ball().astype(np.uint64) * np.uint64(2**64 - 1), one),
        (ValueError, "spacing", ball(), None),
        (TypeError, "", ball(), (1.0, 1.0)),
    ]
    for kind, said, array, spacing in wrong:
        with pytest.raises(kind, match=said):
            viscera.read_labels(array, spacing)
    refused = [
        ("shape", np.zeros((0, 4, 4), int), {"spacing": one}),
        ("voxel values", np.zeros((4, 4, 4), int), {"spacing": one}),
        ("spacing", ball(), {"spacing": (1.0, 0.0, 1.0)}),
        ("spacing", ball(), {"spacing": (1.0, -1.0, 1.0)}),
        ("spacing", ball(), {"spacing": (1.0, float("nan"), 1.0)}),
        ("origin", ball(), {"spacing": one, "origin": (float("inf"), 0.0, 0.0)}),
        ("direction", ball(), {"spacing": one, "direction": (1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0)}),
        ("labels.tumour", ball(), {"spacing": one, "labels": {"tumour": 7}}),
        ("min_componet", ball(), {"spacing": one, "min_componet": "1 ml"}),
        ("min_component", ball(), {"spacing": one, "min_component": "1 l"}),
    ]
    for field, array, given in refused:
        with pytest.raises(viscera.Error) as caught:
            viscera.read_labels(array, **given)
        assert field in caught.value.field, caught.value
        assert caught.value.exit_code in (3, 4)
        assert caught.value.where in ("array", "params", "parameters")


def test_what_cannot_be_meshed_says_why_and_leaves_the_labels_usable():
    labels = viscera.read_labels(ball(), (1.0, 1.0, 1.0))
    for params, field in [({"cell_size": "0.01 mm"}, "cell_size"), ({"cell_size": "600 mm"}, "cell_size"),
                          ({"formats": ["msh"]}, "formats"), ({"time_limit": "1 s"}, "time_limit"),
                          ({"route": "surface"}, "route"), ({"sizes": {"liver": "1 mm"}}, "sizes.liver")]:
        with pytest.raises(viscera.Error) as caught:
            labels.tet_mesh(**params)
        assert caught.value.field == field
        assert caught.value.exit_code == 3
    mesh = labels.tet_mesh(cell_size="3 mm")
    middle = 0.5 * (mesh.points.min(axis=0) + mesh.points.max(axis=0))
    np.testing.assert_allclose(middle, 9.5, atol=0.3)


def test_surfaces_that_enclose_nothing_are_refused():
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    for points, triangles, field in [(corners, faces + 1, "triangles"), (corners, faces - 1, "triangles"),
                                     (corners * np.nan, faces, "points")]:
        with pytest.raises(viscera.Error) as caught:
            viscera.Surface(points, triangles)
        assert caught.value.field == field
    with pytest.raises(viscera.Error):
        viscera.Surface(corners, faces[:3]).tet_mesh(cell_size="3 mm")
    with pytest.raises(viscera.Error):
        viscera.Surface(corners[:0], faces[:0]).tet_mesh(cell_size="3 mm")


def test_threads_mesh_side_by_side_as_one_after_the_other():
    labels = viscera.read_labels(ball(), (1.0, 1.0, 1.0))
    alone = labels.tet_mesh(cell_size="1.5 mm")
    found = []
    crew = [threading.Thread(target=lambda: found.append(labels.tet_mesh(cell_size="1.5 mm"))) for _ in range(4)]
    for thread in crew:
        thread.start()
    for thread in crew:
        thread.join()
    assert len(found) == 4
    for mesh in found:
        np.testing.assert_array_equal(mesh.points, alone.points)
        np.testing.assert_array_equal(mesh.tets, alone.tets)


def test_ctrl_c_ends_meshing():
    # What a shell starts in the background ignores it.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    labels = viscera.read_labels(ball(60, 25.0), (1.0, 1.0, 1.0))
    threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        labels.tet_mesh(cell_size="0.45 mm")
    assert time.monotonic() - begin < 5.0


def test_views_outlive_what_they_show_and_cannot_be_written_to():
    labels = viscera.read_labels(ball(), (1.0, 1.0, 1.0))
    voxels, count = labels.voxels, int((labels.voxels > 0).sum())
    del labels
    assert int((voxels > 0).sum()) == count
    with pytest.raises(ValueError):
        voxels[0, 0, 0] = 1


def test_a_simulation_loads_no_library_of_meshing():
    script = """
import viscera
maps = open("/proc/self/maps").read()
assert "_preparation" not in maps and "libgmsh" not in maps and "libdcm" not in maps
viscera.read_labels
assert "_preparation" in open("/proc/self/maps").read()
"""
    subprocess.run([sys.executable, "-c", script], check=True)


def test_labels_surfaces_and_meshes_that_are_gone_leave_no_memory():
    def one():
        labels = viscera.read_labels(ball(), (1.0, 1.0, 1.0))
        with pytest.raises(viscera.Error):
            labels.tet_mesh(cell_size="600 mm")
        return labels.surface().tet_mesh(cell_size="3 mm").points

    for _ in range(15):
        one()
    before = resident_kb()
    for _ in range(30):
        one()
    # One mesh with its labels and surface takes some 300 kB.
    assert resident_kb() - before < 3000
