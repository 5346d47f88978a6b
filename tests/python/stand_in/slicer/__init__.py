"""In place of 3D Slicer, which no registry of packages has: what the module asks of it, and no more.

Of a segmentation the binary labelmap is an array of ids that its segments share. Sequences and their proxy nodes
copy nodes in depth, as Slicer's do. Files are written as Slicer writes them: volumes of labels as NRRD in LPS,
markups as JSON in LPS.
"""

import gzip
import json
import pathlib
import types

import numpy as np
import vtk


class vtkSegmentationConverter:
    @staticmethod
    def GetSegmentationBinaryLabelmapRepresentationName():
        return "Binary labelmap"

    @staticmethod
    def GetSegmentationClosedSurfaceRepresentationName():
        return "Closed surface"


def empty_representation(name):
    return vtk.vtkPolyData() if name == "Closed surface" else np.zeros((0, 0, 0), np.int16)


def deep_copy(representation):
    if isinstance(representation, np.ndarray):
        return representation.copy()
    copy = vtk.vtkPolyData()
    copy.DeepCopy(representation)
    return copy


class vtkSegment:
    def __init__(self):
        self.name, self.color, self.value, self.representations = None, (0.5, 0.5, 0.5), 1, {}
        self.tags = {"TerminologyEntry": "Segmentation category and type - 3D Slicer General Anatomy list"
                                         "~SCT^85756007^Tissue~SCT^85756007^Tissue~^^~"
                                         "Anatomic codes - DICOM master list~^^~^^"}

    def GetName(self):
        return self.name

    def SetName(self, name):
        self.name = name

    def GetColor(self):
        return self.color

    def SetColor(self, r, g, b):
        self.color = (r, g, b)

    def SetLabelValue(self, value):
        self.value = value

    @staticmethod
    def GetTerminologyEntryTagName():
        return "TerminologyEntry"

    def SetTag(self, name, value):
        self.tags[name] = value

    def GetTag(self, name, found):
        if name not in self.tags:
            return False
        found.set(self.tags[name])
        return True

    def DeepCopyMetadata(self, source):
        self.name, self.color, self.value, self.tags = source.name, source.color, source.value, dict(source.tags)

    def AddRepresentation(self, name, representation):
        self.representations[name] = representation
        return True

    def GetRepresentation(self, name):
        return self.representations.get(name)


class vtkSegmentation:
    def __init__(self):
        self.segments, self.source = {}, "Binary labelmap"

    def SetSourceRepresentationName(self, name):
        self.source = name

    def GetSourceRepresentationName(self):
        return self.source

    def AddSegment(self, segment, segment_id):
        """An empty segment gets an empty source representation; others are to have one."""
        if not segment.representations:
            segment.AddRepresentation(self.source, empty_representation(self.source))
        assert self.source in segment.representations and segment_id not in self.segments
        self.segments[segment_id] = segment
        return True

    def RemoveSegment(self, segment_id):
        del self.segments[segment_id]

    def GetNumberOfSegments(self):
        return len(self.segments)

    def GetNthSegmentID(self, number):
        return list(self.segments)[number]

    def GetSegment(self, segment_id):
        return self.segments.get(segment_id)

    def DeepCopy(self, other):
        self.segments, self.source = {}, other.source
        for segment_id, segment in other.segments.items():
            copy = vtkSegment()
            copy.DeepCopyMetadata(segment)
            for name, representation in segment.representations.items():
                copy.AddRepresentation(name, deep_copy(representation))
            self.AddSegment(copy, segment_id)


class Node:
    def __init__(self, name=""):
        self.name, self.display = name, None

    def SetName(self, name):
        self.name = name

    def GetName(self):
        return self.name

    def GetID(self):
        return f"{type(self).__name__}-{self.name}"

    def CreateDefaultDisplayNodes(self):
        self.display = Display()

    def GetDisplayNode(self):
        return self.display


class Display:
    visible = True

    def SetActiveScalarName(self, name):
        self.scalars = name

    def SetScalarVisibility(self, on):
        self.scalars_visible = on

    def SetVisibility(self, on):
        self.visible = on


class vtkMRMLSegmentationNode(Node):
    """Of a binary labelmap: spacing and origin, as it lies in the patient, LPS mm."""

    def __init__(self, name=""):
        super().__init__(name)
        self.segmentation, self.spacing, self.origin = vtkSegmentation(), None, None

    def GetSegmentation(self):
        return self.segmentation

    def CopyContent(self, other):
        self.segmentation.DeepCopy(other.segmentation)
        self.spacing, self.origin = other.spacing, other.origin


class vtkMRMLLabelMapVolumeNode(Node):
    pass


class vtkMRMLMarkupsFiducialNode(Node):
    def __init__(self, name, points):
        super().__init__(name)
        self.points = points  # by name, LPS mm


class vtkMRMLModelNode(Node):
    surface = None

    def CopyContent(self, other):
        self.surface = other.surface and deep_copy(other.surface)

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
        copy = type(node)(node.GetName())
        copy.CopyContent(node)
        self.items = [item for item in self.items if item[0] != value] + [(value, copy)]

    def GetDataNodeAtValue(self, value):
        return dict(self.items).get(value)


class vtkMRMLSequenceBrowserNode(Node):
    """Of what it browses it shows the first item."""

    def __init__(self, name):
        super().__init__(name)
        self.sequences, self.proxies = [], {}

    def SetAndObserveMasterSequenceNodeID(self, node_id):
        self.sequences = [node_id]

    def AddSynchronizedSequenceNodeID(self, node_id):
        self.sequences.append(node_id)

    def SetPlaybackRateFps(self, rate):
        self.rate = rate

    def GetProxyNode(self, sequence):
        return self.proxies.get(sequence.GetID())


class Scene:
    def __init__(self):
        self.nodes = []

    def AddNewNodeByClass(self, kind, name):
        self.nodes.append(globals()[kind](name))
        return self.nodes[-1]

    def RemoveNode(self, node):
        self.nodes.remove(node)

    def GetNodeByID(self, node_id):
        return next((node for node in self.nodes if node.GetID() == node_id), None)


class SegmentationsLogic:
    @staticmethod
    def ExportSegmentsToLabelmapNode(node, ids, volume, reference):
        for number in range(ids.GetNumberOfValues()):
            segment = node.GetSegmentation().GetSegment(ids.GetValue(number))
            stored = segment.GetRepresentation("Binary labelmap")
            if number == 0:
                volume.ids = np.zeros_like(stored, np.int16)
            volume.ids[stored == segment.value] = number + 1
        volume.spacing, volume.origin = node.spacing, node.origin
        return True


class SequencesLogic:
    @staticmethod
    def UpdateProxyNodesFromSequences(browser):
        for node_id in browser.sequences:
            stored = mrmlScene.GetNodeByID(node_id).items[0][1]
            if node_id not in browser.proxies:
                browser.proxies[node_id] = mrmlScene.AddNewNodeByClass(type(stored).__name__, stored.GetName())
            browser.proxies[node_id].CopyContent(stored)


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
