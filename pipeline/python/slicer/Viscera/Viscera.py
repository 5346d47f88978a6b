"""A module of 3D Slicer: the segments of a segmentation as a soft body, simulated by viscera's programs.

Add this folder to Slicer's additional module paths (Edit, Application Settings, Modules) and set the
environment variable VISCERA_BIN to the folder of the programs. They run as processes of their own:
Slicer's Python is another than that of the wheel. Slicer's scene is in RAS mm; viscera's files are in LPS mm.
"""

import json
import pathlib
import re
import sys
import tempfile

import numpy as np
import slicer
import vtk
from slicer.ScriptedLoadableModule import (ScriptedLoadableModule, ScriptedLoadableModuleLogic,
                                           ScriptedLoadableModuleWidget)
from vtk.util import numpy_support

HERE = pathlib.Path(__file__).resolve().parent
# programs.py is installed beside this file; among the sources it is part of the wheel.
sys.path += [str(HERE), str(HERE.parents[1] / "viscera")]
import programs  # noqa: E402
import tissues  # noqa: E402

SIDES = ["right", "left", "anterior", "posterior", "superior", "inferior"]


class Viscera(ScriptedLoadableModule):
    def __init__(self, parent):
        ScriptedLoadableModule.__init__(self, parent)
        parent.title = "Soft-tissue simulation (viscera)"
        parent.categories = ["Simulation"]
        parent.contributors = ["viscera"]
        parent.helpText = ("Segments become a body of tetrahedra that is held on one side and sags under its weight. "
                           "The result is a sequence over time: the body, and a copy of the segmentation whose "
                           "segments move with it. Landmarks move, too.")


class VisceraLogic(ScriptedLoadableModuleLogic):
    """All that needs no window."""

    def segments_of(self, segmentation):
        """The segments in order: dicts of id, name, label (the key in the scene), material and its origin."""
        own = segmentation.GetSegmentation()
        found = []
        for number in range(own.GetNumberOfSegments()):
            segment_id = own.GetNthSegmentID(number)
            segment = own.GetSegment(segment_id)
            entry = vtk.mutable("")
            has_code = segment.GetTag(segment.GetTerminologyEntryTagName(), entry)
            material, origin = tissues.material_of(str(entry) if has_code else "")
            label = re.sub(r"\W+", "_", segment.GetName()).strip("_").lower() or "segment"
            if any(other["label"] == label for other in found):
                label = f"{label}_{number + 1}"
            found.append({"id": segment_id, "name": segment.GetName(), "label": label, "material": dict(material),
                          "origin": origin})
        return found

    def write_case(self, folder, segmentation, segments, *, reference=None, landmarks=None, held="right",
                   within_mm=30.0, target_tets=20000, end_s=8.0):
        """Writes labels, scene and spec into a folder; returns the spec's path.

        Segments with the same label are simulated as one material, that of the first.
        reference: the volume whose voxels the labels get. landmarks: a node of points to follow.
        """
        folder = pathlib.Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        ids = vtk.vtkStringArray()
        for segment in segments:
            ids.InsertNextValue(segment["id"])
        volume = slicer.mrmlScene.AddNewNodeByClass("vtkMRMLLabelMapVolumeNode", "viscera labels")
        try:
            logic = slicer.modules.segmentations.logic()
            if not logic.ExportSegmentsToLabelmapNode(segmentation, ids, volume, reference):
                raise RuntimeError("Slicer could not write the segments as a volume of labels")
            slicer.util.saveNode(volume, str(folder / "labels.nrrd"))
        finally:
            slicer.mrmlScene.RemoveNode(volume)
        labels, materials = {}, {}
        for value, segment in enumerate(segments, 1):
            labels.setdefault(segment["label"], []).append(value)
            materials.setdefault(segment["label"], segment["material"])
        inputs = {"scene": "scene.yaml"}
        if landmarks is not None:
            slicer.util.saveNode(landmarks, str(folder / "landmarks_at_rest.mrk.json"))
            inputs["landmarks"] = "landmarks_at_rest.mrk.json"
        scene = {
            "scene": 1,
            "materials": materials,
            "effects": {"neo_hookean": None, "gravity": {}, "viscosity": None, "fixed": {"region": "support"}},
            "time": {"frame_rate": "60 Hz", "end": f"{end_s} s"},
        }
        spec = {
            "viscera": 1,
            "stages": {
                "labels": {"in": {"volume": "labels.nrrd"}, "labels": labels},
                "surface": {},
                "tetmesh": {"target_tets": target_tets,
                            "regions": {"support": {"side": held, "within": f"{within_mm} mm"}}},
                "simulate": {"in": inputs},
                "report": {"title": segmentation.GetName()},
            },
        }
        (folder / "scene.yaml").write_text(json.dumps(scene, indent=1))  # JSON is YAML, too
        file = folder / "case.yaml"
        file.write_text(json.dumps(spec, indent=1))
        return file

    def run(self, spec, progress=None):
        """Runs a case; returns its stages by name. programs.Failed says what was wrong."""
        return programs.run(spec, out=pathlib.Path(spec).parent / "out", progress=progress)

    def show(self, stages, segmentation, segments):
        """Puts a run into the scene: two sequences over time in one browser, and the landmarks at the end.

        One sequence is the body as a model, with the distance from rest in mm; it is hidden at first, since it covers
        the segments. The other is a copy of the segmentation: the segments of the run with their IDs, names, colours
        and tags, as closed surfaces that move. Such a surface bounds the tets of the segment's label: it is that of
        the simulated body, not of the voxels. Segments with the same label have the same surface, that of all of
        them, and a segment of which the mesh has no tet is empty. Segments that were not simulated are left out, and
        the segmentation itself stays as it is.

        Returns the browser's node.
        """
        folder = stages["simulate"].folder
        name = segmentation.GetName()
        scene = slicer.mrmlScene
        body = slicer.vtkMRMLModelNode()
        body.SetName(name)
        copy = copy_without_surfaces(segmentation, segments)
        bodies, copies = sequences = [scene.AddNewNodeByClass("vtkMRMLSequenceNode", f"{node.GetName()} over time")
                                      for node in (body, copy)]
        try:
            for sequence in sequences:
                sequence.SetIndexName("time")
                sequence.SetIndexUnit("s")
            for time_s, surface, surfaces in read_frames(folder / "trajectory.h5"):
                time = f"{time_s:.4f}"
                store(bodies, body, time).SetAndObservePolyData(surface)
                own = store(copies, copy, time).GetSegmentation()
                for segment in segments:
                    moved = own.GetSegment(segment["id"])
                    if moved and segment["label"] in surfaces:
                        moved.AddRepresentation(closed_surface(), surfaces[segment["label"]])
        except BaseException:
            for sequence in sequences:
                scene.RemoveNode(sequence)
            raise
        browser = scene.AddNewNodeByClass("vtkMRMLSequenceBrowserNode", f"{name} browser")
        browser.SetAndObserveMasterSequenceNodeID(bodies.GetID())
        browser.AddSynchronizedSequenceNodeID(copies.GetID())
        browser.SetPlaybackRateFps(60.0)
        slicer.modules.sequences.logic().UpdateProxyNodesFromSequences(browser)
        for sequence in sequences:
            browser.GetProxyNode(sequence).CreateDefaultDisplayNodes()
        display = browser.GetProxyNode(bodies).GetDisplayNode()
        display.SetActiveScalarName("displacement_mm")
        display.SetScalarVisibility(True)
        display.SetVisibility(False)
        landmarks = folder / "landmarks.mrk.json"
        if landmarks.exists():
            slicer.util.loadMarkups(str(landmarks))
        return browser


def closed_surface():
    return slicer.vtkSegmentationConverter.GetSegmentationClosedSurfaceRepresentationName()


def copy_without_surfaces(segmentation, segments):
    """A segmentation, not of the scene, of empty segments with the IDs, names, colours and tags of those given.

    One that the user has removed meanwhile is left out.
    """
    copy = slicer.vtkMRMLSegmentationNode()
    copy.SetName(f"{segmentation.GetName()} simulated")
    own = copy.GetSegmentation()
    own.SetSourceRepresentationName(closed_surface())
    for segment in segments:
        original = segmentation.GetSegmentation().GetSegment(segment["id"])
        if original:
            empty = slicer.vtkSegment()
            empty.DeepCopyMetadata(original)
            own.AddSegment(empty, segment["id"])
    return copy


def store(sequence, node, value):
    """Stores a copy of a node at an index value and returns it: a surface that it is given then is not copied."""
    sequence.SetDataNodeAtValue(node, value)
    return sequence.GetDataNodeAtValue(value)


class Boundary:
    """The faces that belong to one of the given tets alone. The surfaces of all frames share their triangles."""

    def __init__(self, tets):
        faces = tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
        _, first, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
        self.vertices, corners = np.unique(faces[np.sort(first[count == 1])], return_inverse=True)
        cells = np.insert(corners.reshape(-1, 3), 0, 3, axis=1).astype(np.int64)
        self.triangles = vtk.vtkCellArray()
        self.triangles.SetCells(len(cells), numpy_support.numpy_to_vtkIdTypeArray(cells.ravel(), deep=True))

    def surface(self, positions):
        """The vtkPolyData of a frame, of the positions of all vertices of the mesh."""
        points = vtk.vtkPoints()
        points.SetData(numpy_support.numpy_to_vtk(positions[self.vertices], deep=True))
        surface = vtk.vtkPolyData()
        surface.SetPoints(points)
        surface.SetPolys(self.triangles)
        return surface


def read_frames(file):
    """Frame by frame of a trajectory.h5: the time (s), the boundary of the body with the distance from rest, and by
    label the boundary of its tets. They are vtkPolyData in RAS mm."""
    try:
        import h5py
    except ImportError:  # Slicer does not come with it
        slicer.util.pip_install("h5py")
        import h5py

    to_ras = np.array([-1, -1, 1], np.float32)
    with h5py.File(file, "r") as stored:
        tets, label_of = stored["tets"][:], stored["labels"][:]
        body = Boundary(tets)
        labels = {name.decode(): Boundary(tets[label_of == label])
                  for label, name in zip(stored["label_ids"], stored["label_names"]) if np.any(label_of == label)}
        at_rest = stored["points"][:] * to_ras
        for time_s, positions in zip(stored["times"], stored["positions"]):
            now = positions * to_ras
            moved = numpy_support.numpy_to_vtk(np.linalg.norm(now - at_rest, axis=1)[body.vertices], deep=True)
            moved.SetName("displacement_mm")
            surface = body.surface(now)
            surface.GetPointData().AddArray(moved)
            yield float(time_s), surface, {name: boundary.surface(now) for name, boundary in labels.items()}


class VisceraWidget(ScriptedLoadableModuleWidget):
    COLUMNS = ["use", "segment", "E", "nu", "density", "damping"]

    def setup(self):
        import ctk
        import qt

        ScriptedLoadableModuleWidget.setup(self)
        self.logic = VisceraLogic()
        self.cancelled = False
        box = ctk.ctkCollapsibleButton()
        box.text = "Body, support and run"
        self.layout.addWidget(box)
        form = qt.QFormLayout(box)

        self.segmentation = self._selector(["vtkMRMLSegmentationNode"])
        form.addRow("Segmentation", self.segmentation)
        self.table = qt.QTableWidget()
        self.table.setColumnCount(len(self.COLUMNS))
        self.table.setHorizontalHeaderLabels(self.COLUMNS)
        form.addRow(self.table)
        self.landmarks = self._selector(["vtkMRMLMarkupsFiducialNode"], none=True)
        form.addRow("Landmarks to follow", self.landmarks)
        self.held = qt.QComboBox()
        self.held.addItems(SIDES)
        form.addRow("Held at the side", self.held)
        self.within = qt.QDoubleSpinBox()
        self.within.setRange(1.0, 500.0)
        self.within.setValue(30.0)
        self.within.suffix = " mm"
        form.addRow("as deep as", self.within)
        self.tets = qt.QSpinBox()
        self.tets.setRange(500, 2000000)
        self.tets.setValue(20000)
        form.addRow("Tetrahedra", self.tets)
        self.start = qt.QPushButton("Simulate")
        self.stop = qt.QPushButton("Cancel")
        self.stop.enabled = False
        self.bar = qt.QProgressBar()
        self.status = qt.QLabel()
        self.status.wordWrap = True
        for widget in (self.start, self.stop, self.bar, self.status):
            form.addRow(widget)
        self.layout.addStretch(1)
        self.segmentation.connect("currentNodeChanged(vtkMRMLNode*)", self.fill)
        self.start.connect("clicked()", self.simulate)
        self.stop.connect("clicked()", self.cancel)
        self.fill(self.segmentation.currentNode())

    def _selector(self, types, none=False):
        selector = slicer.qMRMLNodeComboBox()
        selector.nodeTypes = types
        selector.addEnabled = selector.removeEnabled = False
        selector.noneEnabled = none
        selector.setMRMLScene(slicer.mrmlScene)
        return selector

    def fill(self, segmentation):
        import qt

        self.segments = self.logic.segments_of(segmentation) if segmentation else []
        self.table.setRowCount(len(self.segments))
        for row, segment in enumerate(self.segments):
            use = qt.QTableWidgetItem()
            use.setCheckState(qt.Qt.Checked)
            self.table.setItem(row, 0, use)
            texts = [segment["name"]] + [str(segment["material"][key]) for key in self.COLUMNS[2:]]
            for column, text in enumerate(texts, 1):
                item = qt.QTableWidgetItem(text)
                item.setToolTip(segment["origin"])
                self.table.setItem(row, column, item)

    def chosen(self):
        """The segments in use, with the values of the table."""
        import qt

        found = []
        for row, segment in enumerate(self.segments):
            if self.table.item(row, 0).checkState() != qt.Qt.Checked:
                continue
            values = {key: self.table.item(row, column).text()
                      for column, key in enumerate(self.COLUMNS) if column > 1}
            found.append({**segment, "material": {**values, "nu": float(values["nu"])}})
        return found

    def cancel(self):
        self.cancelled = True

    def simulate(self):
        self.cancelled = False
        self.start.enabled, self.stop.enabled = False, True
        try:
            segmentation = self.segmentation.currentNode()
            folder = pathlib.Path(tempfile.mkdtemp(prefix="viscera-", dir=slicer.app.temporaryPath))
            segments = self.chosen()
            spec = self.logic.write_case(folder, segmentation, segments, landmarks=self.landmarks.currentNode(),
                                         held=self.held.currentText, within_mm=self.within.value,
                                         target_tets=self.tets.value)
            stages = self.logic.run(spec, self.progress)
            self.logic.show(stages, segmentation, segments)
            self.status.text = summary(stages)
        except programs.Cancelled:
            self.status.text = "cancelled"
        except Exception as error:
            self.status.text = str(error)
            slicer.util.errorDisplay(str(error))
        finally:
            self.start.enabled, self.stop.enabled = True, False

    def progress(self, share, what):
        self.bar.setValue(int(100 * share))
        self.status.text = what
        slicer.app.processEvents()
        return not self.cancelled


def summary(stages):
    """What must be known before a result is used: gates that failed, caveats, and where the report is."""
    lines = []
    for name, stage in stages.items():
        lines += [f"FAILED: gate {gate} of {name}" for gate, it in stage.gates.items() if not it["passed"]]
        lines += stage.caveats
    if "report" in stages:
        lines.append(f"report: {stages['report'].folder / 'report.html'}")
    return "\n".join(lines)
