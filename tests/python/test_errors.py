"""Bad input ends in an exception that says what, where and what to do; nothing crashes."""

import numpy as np
import pytest
import viscera
from conftest import cube, falling


def test_an_unknown_effect_is_named_with_the_nearest(mesh):
    scene = falling()
    scene["effects"]["gravty"] = {}
    with pytest.raises(viscera.Error) as caught:
        viscera.Simulation(mesh, scene)
    error = caught.value
    assert error.exit_code == 3
    assert "gravty" in error.field
    assert "gravity" in error.remedy
    assert error.where.split(":")[0].endswith(".yaml")


def test_a_param_out_of_range_is_refused_by_name(mesh):
    for params, field in [({"substeps": 0}, "substeps"), ({"sover": "fem"}, "sover"),
                          ({"end": "3 kg"}, "end"), ({"device": "tpu"}, "device")]:
        with pytest.raises(viscera.Error) as caught:
            viscera.Simulation(mesh, falling(), **params)
        assert caught.value.field == field
        assert caught.value.exit_code == 3


def test_a_label_without_a_material_is_named():
    with pytest.raises(viscera.Error) as caught:
        viscera.Simulation(viscera.TetMesh(*cube()), falling())
    assert caught.value.field == "materials.label_1"


def test_arrays_of_another_shape_or_type_are_refused():
    points, tets = cube()
    wrong = [
        (ValueError, "points", (points[:, :2], tets)),
        (ValueError, "points", (points.ravel(), tets)),
        (ValueError, "tets", (points, tets[:, :3])),
        (TypeError, "tets", (points, tets.astype(float))),
        (TypeError, "labels", (points, tets, np.ones(len(tets)))),
        (ValueError, "labels", (points, tets, np.ones(3, int))),
        (ValueError, "labels", (points, tets, np.full(len(tets), 65536))),
        (ValueError, "tets", (points, tets + np.int64(2**32))),
        (ValueError, "tets", (points, tets.astype(np.uint64) + np.uint64(2**63))),
    ]
    for kind, name, arguments in wrong:
        with pytest.raises(kind, match=name):
            viscera.TetMesh(*arguments)
    with pytest.raises(TypeError, match="points"):
        viscera.TetMesh("points", tets)


def test_arrays_of_any_order_and_width_mean_the_same():
    points, tets = cube()
    plain = viscera.TetMesh(points, tets)
    for given in [(np.asfortranarray(points), tets.astype(np.int64)),
                  (points.astype(">f8"), np.repeat(tets, 2, axis=0)[::2]),
                  (points.tolist(), tets.tolist())]:
        mesh = viscera.TetMesh(*given)
        np.testing.assert_array_equal(mesh.points, plain.points)
        np.testing.assert_array_equal(mesh.tets, plain.tets)
    points.flags.writeable = False
    viscera.TetMesh(points, tets)


def test_a_mesh_that_no_body_can_have_is_refused():
    points, tets = cube()
    nan = points.copy()
    nan[3, 1] = np.nan
    far = tets.copy()
    far[5, 2] = len(points)
    turned = tets.copy()
    turned[0, [0, 1]] = turned[0, [1, 0]]
    stray = np.vstack([points, [[500.0, 0.0, 0.0]]])
    nothing = np.empty((0, 4), int)
    twice = np.vstack([tets, tets[:1]])
    for arguments in [(nan, tets), (points, far), (points, -tets), (points, turned), (stray, tets),
                      (points, nothing), (points, twice)]:
        with pytest.raises(viscera.Error) as caught:
            viscera.Simulation(viscera.TetMesh(*arguments, names={1: "liver"}), falling())
        assert caught.value.exit_code == 4
        assert caught.value.found


def test_values_that_no_scene_holds_are_refused(mesh):
    itself = {}
    itself["change"] = itself
    with pytest.raises(ValueError, match="nested"):
        viscera.Simulation(mesh, falling(), change=itself)
    with pytest.raises(TypeError, match="neither text"):
        viscera.Simulation(mesh, falling(), change=object())
    with pytest.raises(viscera.Error):
        viscera.Simulation(mesh, "no/such/scene.yaml")
    with pytest.raises(viscera.Error):
        viscera.read_mesh("no/such/mesh.vtu")
    with pytest.raises(ValueError, match="frames"):
        viscera.Simulation(mesh, falling()).step(-1)


def test_a_device_that_is_not_there_is_said():
    mesh = viscera.TetMesh(*cube(), names={1: "liver"})
    try:
        sim = viscera.Simulation(mesh, falling(), device="cuda")
    except viscera.Error as error:
        assert error.exit_code == 6
        assert error.remedy or error.found
    else:
        assert sim.device.startswith("cuda")
