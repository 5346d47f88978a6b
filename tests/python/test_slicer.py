"""The module of 3D Slicer, against a stand-in for Slicer (stand_in/slicer): its logic, not its window."""

import importlib
import json
import pathlib
import sys

import numpy as np
import pytest
from conftest import PROGRAMS, read_nrrd
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
    segments = {"one": slicer.Segment("Liver", 1, LIVER), "two": slicer.Segment("Tumour, left", 2, "")}
    return slicer.vtkMRMLSegmentationNode("patient", ids, spacing, origin, segments)


def case(module, segmentation, folder, **more):
    logic = module.VisceraLogic()
    return logic, logic.write_case(folder, segmentation, logic.segments_of(segmentation), target_tets=1500, end_s=0.2,
                                   **more)


def test_segments_have_the_material_of_their_code_and_a_name_that_a_scene_takes(module, segmentation):
    liver, tumour = module.VisceraLogic().segments_of(segmentation)
    assert (liver["label"], tumour["label"]) == ("liver", "tumour_left")
    assert "elastography" in liver["origin"]
    assert tumour["origin"].startswith("not known")
    assert module.tissues.code_of("a~b") == module.tissues.code_of("") == ""
    assert module.tissues.material_of("x~y~SCT^4147007^Mass~^^")[0]["E"] == "15 kPa"


def test_a_case_becomes_a_sequence_in_the_place_of_the_segmentation(module, segmentation, tmp_path):
    slicer = sys.modules["slicer"]
    ids, spacing, origin = segmentation.ids, np.array(segmentation.spacing), np.array(segmentation.origin)
    corners = np.argwhere(np.isin(ids, (1, 2)))[:, ::-1] * spacing + origin  # LPS mm
    middle = corners.mean(axis=0)
    marks = slicer.vtkMRMLMarkupsFiducialNode("marks", {"tip": list(middle)})
    logic, spec = case(module, segmentation, tmp_path, landmarks=marks)
    heard = []
    stages = logic.run(spec, lambda share, what: heard.append((share, what)))
    assert list(stages) == ["labels", "surface", "tetmesh", "simulate", "report"]
    assert heard[-1][0] == 1.0
    assert [share for share, _ in heard] == sorted(share for share, _ in heard)
    assert stages["simulate"].metrics["tets"] > 1000
    assert json.loads(spec.read_text())["stages"]["labels"]["labels"] == {"liver": 1, "tumour_left": 2}

    browser = logic.show(stages, "patient")
    sequence = next(node for node in slicer.mrmlScene.nodes if isinstance(node, slicer.vtkMRMLSequenceNode))
    assert browser.master == sequence.GetID()
    assert [value for value, _ in sequence.items][:2] == ["0.0000", "0.0167"]
    assert len(sequence.items) == 13
    points = [numpy_support.vtk_to_numpy(node.GetPolyData().GetPoints().GetData()) for _, node in sequence.items]
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


def test_a_run_can_be_cancelled_and_goes_on_from_what_it_had(module, segmentation, tmp_path):
    logic, spec = case(module, segmentation, tmp_path)
    with pytest.raises(module.programs.Cancelled):
        logic.run(spec, lambda share, what: share < 0.5)
    assert not list((tmp_path / "out/.cache/work").iterdir()), "what it was at is cleared away"
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
    with pytest.raises(FileNotFoundError, match="make run builds it"):
        module.programs.program("viscera-absent")
