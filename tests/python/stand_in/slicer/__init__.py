"""In place of 3D Slicer, which no registry of packages has: what the module asks of it, and no more.

A segmentation is an array of ids; nodes keep what they are given. Files are written as Slicer writes
them: volumes of labels as NRRD in LPS, markups as JSON in LPS.
"""

import gzip
import json
import pathlib
import types

import numpy as np
import vtk


class Segment:
    def __init__(self, name, value, entry):
        self.name, self.value, self.entry = name, value, entry

    def GetName(self):
        return self.name

    @staticmethod
    def GetTerminologyEntryTagName():
        return "TerminologyEntry"

    def GetTag(self, name, found):
        if name != "TerminologyEntry" or not self.entry:
            return False
        found.set(self.entry)
        return True


class Segmentation:
    def __init__(self, segments):
        self.segments = segments

    def GetNumberOfSegments(self):
        return len(self.segments)

    def GetNthSegmentID(self, number):
        return list(self.segments)[number]

    def GetSegment(self, segment_id):
        return self.segments[segment_id]


class Node:
    def __init__(self, name=""):
        self.name, self.display = name, None

    def SetName(self, name):
        self.name = name

    def GetName(self):
        return self.name

    def GetID(self):
        return f"node-{self.name}"

    def CreateDefaultDisplayNodes(self):
        self.display = Display()

    def GetDisplayNode(self):
        return self.display


class Display:
    def SetActiveScalarName(self, name):
        self.scalars = name

    def SetScalarVisibility(self, on):
        self.visible = on


class vtkMRMLSegmentationNode(Node):
    """ids [k, j, i] of the volume, and how they lie in the patient, LPS mm."""

    def __init__(self, name, ids, spacing, origin, segments):
        super().__init__(name)
        self.ids, self.spacing, self.origin = ids, spacing, origin
        self.segmentation = Segmentation(segments)

    def GetSegmentation(self):
        return self.segmentation


class vtkMRMLLabelMapVolumeNode(Node):
    pass


class vtkMRMLMarkupsFiducialNode(Node):
    def __init__(self, name, points):
        super().__init__(name)
        self.points = points  # by name, LPS mm


class vtkMRMLModelNode(Node):
    def SetAndObservePolyData(self, surface):
        self.surface = surface

    def GetPolyData(self):
        return self.surface


class vtkMRMLSequenceNode(Node):
    def __init__(self, name):
        super().__init__(name)
        self.items = []

    def SetIndexName(self, name):
        self.index_name = name

    def SetIndexUnit(self, unit):
        self.index_unit = unit

    def SetDataNodeAtValue(self, node, value):
        self.items.append((value, node))


class vtkMRMLSequenceBrowserNode(Node):
    def SetAndObserveMasterSequenceNodeID(self, node_id):
        self.master = node_id

    def SetPlaybackRateFps(self, rate):
        self.rate = rate

    def GetProxyNode(self, sequence):
        return sequence.items[0][1] if sequence.GetID() == self.master else None


class Scene:
    def __init__(self):
        self.nodes = []

    def AddNewNodeByClass(self, kind, name):
        self.nodes.append(globals()[kind](name))
        return self.nodes[-1]

    def RemoveNode(self, node):
        self.nodes.remove(node)


class SegmentationsLogic:
    @staticmethod
    def ExportSegmentsToLabelmapNode(node, ids, volume, reference):
        volume.ids = np.zeros_like(node.ids, np.int16)
        for number in range(ids.GetNumberOfValues()):
            segment = node.GetSegmentation().GetSegment(ids.GetValue(number))
            volume.ids[node.ids == segment.value] = number + 1
        volume.spacing, volume.origin = node.spacing, node.origin
        return True


class SequencesLogic:
    @staticmethod
    def UpdateProxyNodesFromSequences(browser):
        browser.updated = True


def save_node(node, file):
    if isinstance(node, vtkMRMLMarkupsFiducialNode):
        points = [{"id": str(i), "label": name, "position": list(at), "positionStatus": "defined"}
                  for i, (name, at) in enumerate(node.points.items())]
        pathlib.Path(file).write_text(json.dumps(
            {"markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points}]}))
        return True
    axes = " ".join(f"({','.join(str(s if a == b else 0) for b in range(3))})" for a, s in enumerate(node.spacing))
    header = ("NRRD0004\n# Complete NRRD file format specification at:\n# http://teem.sourceforge.net/nrrd/format.html\n"
              "type: short\ndimension: 3\nspace: left-posterior-superior\n"
              f"sizes: {' '.join(str(n) for n in node.ids.shape[::-1])}\nspace directions: {axes}\n"
              "kinds: domain domain domain\nendian: little\nencoding: gzip\n"
              f"space origin: ({','.join(str(x) for x in node.origin)})\n\n")
    pathlib.Path(file).write_bytes(header.encode() + gzip.compress(node.ids.astype("<i2").tobytes()))
    return True


loaded_markups = []
mrmlScene = Scene()
modules = types.SimpleNamespace(segmentations=types.SimpleNamespace(logic=SegmentationsLogic),
                                sequences=types.SimpleNamespace(logic=SequencesLogic))
util = types.SimpleNamespace(saveNode=save_node, loadMarkups=loaded_markups.append)
assert vtk.vtkVersion  # Slicer's Python has it
