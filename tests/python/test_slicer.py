"""The module of 3D Slicer, against a stand-in for Slicer (stand_in/slicer): its logic, not its window."""

import importlib
import json
import pathlib
import sys
import types

import h5py
import numpy as np
import pytest
from conftest import PROGRAMS, cube, read_nrrd
from vtk.util import numpy_support

HERE = pathlib.Path(__file__).parent
LIVER = ("Segmentation category and type - 3D Slicer General Anatomy list~SCT^123037004^Anatomical Structure"
         "~SCT^10200004^Liver~^^~Anatomic codes - DICOM master list~^^~^^")


@pytest.fixture
def module(monkeypatch):
    monkeypatch.setenv("VISCERA_BIN", str(PROGRAMS.resolve()))
    monkeypatch.syspath_prepend(str(HERE / "stand_in"))
    monkeypatch.syspath_prepend(str(HERE.parents[1] / "pipeline/python/slicer/Viscera"))
    for name in ("slicer", "slicer.ScriptedLoadableModule", "Viscera"):
        sys.modules.pop(name, None)
    return importlib.import_module("Viscera")


@pytest.fixture
def segmentation(module):
    slicer = sys.modules["slicer"]
    ids, spacing, origin, _ = read_nrrd("sample_data/phantom.nrrd")
    node = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLSegmentationNode", "patient")
    node.spacing, node.origin = spacing, origin
    for segment_id, name, value, color in (("one", "Liver", 1, (0.9, 0.4, 0.3)),
                                           ("two", "Tumour, left", 2, (0.2, 0.7, 0.1))):
        segment = slicer.vtkSegment()
        segment.SetName(name)
        segment.SetColor(*color)
        segment.SetLabelValue(value)
        segment.AddRepresentation("Binary labelmap", ids)
        node.GetSegmentation().AddSegment(segment, segment_id)
    node.GetSegmentation().GetSegment("one").SetTag("TerminologyEntry", LIVER)
    return node


def case(module, segmentation, folder, **more):
    logic = module.VisceraLogic()
    return logic, logic.write_case(folder, segmentation, logic.segments_of(segmentation), target_tets=1500, end_s=0.2,
                                   **more)


def voxels(segmentation):
    """The centres of the voxels that the segments have, LPS mm."""
    ids = segmentation.GetSegmentation().GetSegment("one").GetRepresentation("Binary labelmap")
    return np.argwhere(np.isin(ids, (1, 2)))[:, ::-1] * segmentation.spacing + segmentation.origin


def state(node):
    """All that a segmentation node holds, to see whether it changes."""
    own = node.GetSegmentation()
    return own.GetSourceRepresentationName(), node.spacing, node.origin, [
        (key, segment.name, segment.color, segment.value, segment.tags,
         {name: held.tobytes() for name, held in segment.representations.items()})
        for key, segment in own.segments.items()]


def sequences():
    """The sequence of bodies and that of segmentations."""
    slicer = sys.modules["slicer"]
    return [node for node in slicer.mrmlScene.nodes if isinstance(node, slicer.vtkMRMLSequenceNode)]


def points_of(surface):
    return numpy_support.vtk_to_numpy(surface.GetPoints().GetData())


def surface_of(segmentation, segment_id):
    return segmentation.GetSegmentation().GetSegment(segment_id).GetRepresentation("Closed surface")


def check_is_boundary(surface, tets, positions):
    """A surface in RAS has the boundary vertices of tets in LPS, closes them in and faces outwards."""
    faces = {}
    for tet in tets.tolist():
        for left_out in range(4):
            face = frozenset(tet[:left_out] + tet[left_out + 1:])
            faces[face] = faces.get(face, 0) + 1
    outer = [face for face, count in faces.items() if count == 1]
    expected = positions[sorted(frozenset().union(*outer))] * np.float32([-1, -1, 1])
    points = points_of(surface)
    assert np.array_equal(np.unique(points, axis=0), np.unique(expected, axis=0))
    corners = numpy_support.vtk_to_numpy(surface.GetPolys().GetConnectivityArray())
    a, b, c = points.astype(float)[corners.reshape(-1, 3).T]
    assert len(a) == len(outer)
    at = positions.astype(float)
    volume = np.linalg.det(at[tets[:, 1:]] - at[tets[:, :1]]).sum() / 6
    assert np.einsum("ij,ij", a, np.cross(b, c)) / 6 == pytest.approx(volume, rel=1e-4)


@pytest.fixture
def stages(tmp_path):
    """What a run would leave: a cube of which one half is liver and the other tumour, in two frames."""
    points, tets = cube()
    labels = 1 + (points[tets].mean(axis=1)[:, 0] > 25)
    with h5py.File(tmp_path / "trajectory.h5", "w") as file:
        file["points"], file["tets"], file["labels"] = points, tets, labels
        file["label_ids"], file["label_names"] = [1, 2, 3], np.array([b"liver", b"tumour_left", b"gone"])
        file["times"], file["positions"] = [0.0, 1 / 60], np.float32([points, points + [1, 2, -3]])
    return {"simulate": types.SimpleNamespace(folder=tmp_path)}


def test_segments_have_the_material_of_their_code_and_a_name_that_a_scene_takes(module, segmentation):
    liver, tumour = module.VisceraLogic().segments_of(segmentation)
    assert (liver["label"], tumour["label"]) == ("liver", "tumour_left")
    assert "elastography" in liver["origin"]
    assert tumour["origin"].startswith("not known")
    assert module.tissues.code_of("a~b") == module.tissues.code_of("") == ""
    assert module.tissues.material_of("x~y~SCT^4147007^Mass~^^")[0]["E"] == "15 kPa"


def test_a_case_becomes_a_sequence_in_the_place_of_the_segmentation(module, segmentation, tmp_path):
    slicer = sys.modules["slicer"]
    before = state(segmentation)
    spacing, corners = np.array(segmentation.spacing), voxels(segmentation)
    middle = corners.mean(axis=0)
    marks = slicer.vtkMRMLMarkupsFiducialNode("marks", {"tip": list(middle)})
    logic, spec = case(module, segmentation, tmp_path, landmarks=marks)
    heard = []
    stages = logic.run(spec, lambda share, what: heard.append((share, what)))
    assert list(stages) == ["labels", "surface", "tetmesh", "simulate", "report"]
    assert heard[-1][0] == 1.0
    assert [share for share, _ in heard] == sorted(share for share, _ in heard)
    assert stages["simulate"].metrics["tets"] > 1000
    assert json.loads(spec.read_text())["stages"]["labels"]["labels"] == {"liver": [1], "tumour_left": [2]}

    browser = logic.show(stages, segmentation, logic.segments_of(segmentation))
    sequence, copies = sequences()
    assert browser.sequences == [sequence.GetID(), copies.GetID()]
    assert [value for value, _ in sequence.items][:2] == ["0.0000", "0.0167"]
    assert len(sequence.items) == 13
    points = [points_of(node.GetPolyData()) for _, node in sequence.items]
    ras = corners * [-1, -1, 1]
    assert np.all(np.abs(points[0].min(axis=0) - ras.min(axis=0)) < 3 * spacing.max())
    assert np.all(np.abs(points[0].max(axis=0) - ras.max(axis=0)) < 3 * spacing.max())
    assert points[-1][:, 2].mean() < points[0][:, 2].mean() - 0.1  # it sags: inferior is down in RAS, too
    surface = sequence.items[-1][1].GetPolyData()
    moved = numpy_support.vtk_to_numpy(surface.GetPointData().GetArray("displacement_mm"))
    assert moved.max() == pytest.approx(np.linalg.norm(points[-1] - points[0], axis=1).max(), abs=1e-4)
    assert slicer.loaded_markups == [str(stages["simulate"].folder / "landmarks.mrk.json")]
    assert "report: " in module.summary(stages)
    assert not [node for node in slicer.mrmlScene.nodes if isinstance(node, slicer.vtkMRMLLabelMapVolumeNode)]

    assert [value for value, _ in copies.items] == [value for value, _ in sequence.items]
    assert (copies.index_name, copies.index_unit) == (sequence.index_name, sequence.index_unit) == ("time", "s")
    with h5py.File(stages["simulate"].folder / "trajectory.h5") as file:
        tets, labels, positions = file["tets"][:], file["labels"][:], file["positions"][:]
        ids = {name.decode(): label for label, name in zip(file["label_ids"], file["label_names"])}
    for segment in logic.segments_of(segmentation):
        own = tets[labels == ids[segment["label"]]]
        for frame in (0, -1):
            check_is_boundary(surface_of(copies.items[frame][1], segment["id"]), own, positions[frame])
    assert state(segmentation) == before


def test_a_copy_of_the_segmentation_keeps_what_its_segments_are(module, segmentation, stages):
    slicer = sys.modules["slicer"]
    before = state(segmentation)
    logic = module.VisceraLogic()
    browser = logic.show(stages, segmentation, logic.segments_of(segmentation))
    assert state(segmentation) == before
    bodies, copies = sequences()
    shown, body = browser.GetProxyNode(copies), browser.GetProxyNode(bodies)
    assert shown in slicer.mrmlScene.nodes
    assert shown.GetName() == "patient simulated"
    assert shown.GetDisplayNode().visible and not body.GetDisplayNode().visible
    for copy in [shown] + [node for _, node in copies.items]:
        own = copy.GetSegmentation()
        assert own.GetSourceRepresentationName() == "Closed surface"
        assert list(own.segments) == ["one", "two"]
        for segment_id, segment in own.segments.items():
            original = segmentation.GetSegmentation().GetSegment(segment_id)
            assert segment is not original
            assert (segment.name, segment.color, segment.tags) == (original.name, original.color, original.tags)
            assert list(segment.representations) == ["Closed surface"]


def test_all_frames_share_the_triangles_of_a_segment(module, segmentation, stages):
    logic = module.VisceraLogic()
    logic.show(stages, segmentation, logic.segments_of(segmentation))
    bodies, copies = sequences()
    (_, first), (_, last) = copies.items
    for segment_id in ("one", "two"):
        assert surface_of(first, segment_id).GetPolys() is surface_of(last, segment_id).GetPolys()
        moved = points_of(surface_of(last, segment_id)) - points_of(surface_of(first, segment_id))
        assert moved == pytest.approx(np.tile([-1, -2, -3], (len(moved), 1)), abs=1e-4)
    assert bodies.items[0][1].GetPolyData().GetPolys() is bodies.items[1][1].GetPolyData().GetPolys()


def test_segments_that_were_not_simulated_or_are_gone_are_left_out_and_those_without_tets_are_empty(
        module, segmentation, stages):
    logic = module.VisceraLogic()
    liver, tumour = logic.segments_of(segmentation)
    for label, chosen in (("liver", [liver]), ("gone", [{**liver, "label": "gone"}])):
        logic.show(stages, segmentation, chosen)
        copy = sequences()[-1].items[-1][1]
        assert list(copy.GetSegmentation().segments) == ["one"]
        assert (surface_of(copy, "one").GetNumberOfCells() > 0) == (label == "liver")
        for node in sequences():
            sys.modules["slicer"].mrmlScene.RemoveNode(node)
    segmentation.GetSegmentation().RemoveSegment("one")
    logic.show(stages, segmentation, [liver, tumour])
    assert list(sequences()[-1].items[-1][1].GetSegmentation().segments) == ["two"]


def test_two_segments_of_one_label_are_one_body_with_one_surface(module, segmentation, tmp_path):
    logic = module.VisceraLogic()
    segments = [{**segment, "label": "organ"} for segment in logic.segments_of(segmentation)]
    segments[0]["material"]["E"] = "6 kPa"
    spec = logic.write_case(tmp_path, segmentation, segments, target_tets=1500, end_s=0.05)
    assert json.loads(spec.read_text())["stages"]["labels"]["labels"] == {"organ": [1, 2]}
    scene = json.loads((tmp_path / "scene.yaml").read_text())
    assert scene["materials"] == {"organ": {**segments[0]["material"], "E": "6 kPa"}}
    stages = logic.run(spec)
    logic.show(stages, segmentation, segments)
    copy = sequences()[-1].items[-1][1]
    assert [segment.name for segment in copy.GetSegmentation().segments.values()] == ["Liver", "Tumour, left"]
    with h5py.File(stages["simulate"].folder / "trajectory.h5") as file:
        for segment_id in ("one", "two"):
            check_is_boundary(surface_of(copy, segment_id), file["tets"][:], file["positions"][-1])
        volume = np.prod(segmentation.spacing) * len(voxels(segmentation))
        edges = file["points"][:][file["tets"][:]]
        meshed = np.linalg.det(edges[:, 1:] - edges[:, :1]).sum() / 6
    assert meshed == pytest.approx(volume, rel=0.05), "no segment is left out of the body"


def test_a_result_that_cannot_be_read_leaves_nothing_in_the_scene(module, segmentation, stages):
    scene = sys.modules["slicer"].mrmlScene
    logic = module.VisceraLogic()
    segments = logic.segments_of(segmentation)
    file = stages["simulate"].folder / "trajectory.h5"
    with h5py.File(file, "a") as stored:
        positions = stored["positions"][:, 1:]
        del stored["positions"]
        stored["positions"] = positions
    with pytest.raises(ValueError):
        logic.show(stages, segmentation, segments)
    assert scene.nodes == [segmentation]
    file.unlink()
    with pytest.raises(FileNotFoundError):
        logic.show(stages, segmentation, segments)
    assert scene.nodes == [segmentation]


def test_a_run_can_be_cancelled_and_goes_on_from_what_it_had(module, segmentation, tmp_path):
    logic, spec = case(module, segmentation, tmp_path)
    with pytest.raises(module.programs.Cancelled):
        logic.run(spec, lambda share, what: share < 0.5)
    assert not list((tmp_path / "out/.cache/work").iterdir()), "what it was at is cleared away"
    assert sys.modules["slicer"].mrmlScene.nodes == [segmentation]
    heard = []
    assert "simulate" in logic.run(spec, lambda share, what: heard.append(what))
    assert "labels: cached" in heard


def test_what_is_wrong_is_said_as_the_programs_say_it(module, segmentation, tmp_path):
    logic = module.VisceraLogic()
    segments = logic.segments_of(segmentation)
    segments[0]["material"]["nu"] = 0.7
    with pytest.raises(module.programs.Failed, match="materials.liver.nu") as failed:
        logic.run(logic.write_case(tmp_path, segmentation, segments, target_tets=1500))
    assert failed.value.exit_code == 3
    assert sys.modules["slicer"].mrmlScene.nodes == [segmentation]
    with pytest.raises(FileNotFoundError, match="make run builds it"):
        module.programs.program("viscera-absent")
