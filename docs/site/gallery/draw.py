"""Draws one frame of a simulation: the surface of the deformed body, and the obstacles of its scene.

Reads what viscera-simulate writes (trajectory.h5, and scene.json for the obstacles) and draws by VTK,
which needs a display: xvfb-run has one. Positions are those of the patient (LPS), mm; a scene is in SI.
"""
import math

import h5py
import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk

SIZE = (720, 500)  # of a picture, pixels
STRIP = 0.13       # of its height, for the legend
GAP = 2.0          # mm, see solid_behind
MM_PER_M = 1000.0
PAPER = (1.0, 1.0, 1.0)
INK = (0.2, 0.22, 0.25)
STEEL = (0.55, 0.6, 0.66)
FLOOR = (0.85, 0.87, 0.89)
# From little to much, of even steps in lightness, so that it reads in grey as well.
SCALE = [(0.95, 0.90, 0.82), (0.93, 0.72, 0.58), (0.83, 0.45, 0.38), (0.60, 0.20, 0.24), (0.33, 0.06, 0.15)]


class Run:
    """The frame of a trajectory that lies nearest to a time, s; the last without one."""

    def __init__(self, folder, scene, time=None):
        with h5py.File(folder / "trajectory.h5") as file:
            self.rest = file["points"][:]
            self.tets = file["tets"][:]
            self.labels = file["labels"][:]
            names = [name.decode() if isinstance(name, bytes) else name for name in file["label_names"][:]]
            self.label_ids = dict(zip(names, file["label_ids"][:]))
            times = file["times"][:]
            frame = len(times) - 1 if time is None else int(np.argmin(np.abs(times - time)))
            self.time = float(times[frame])
            self.now = file["positions"][frame].astype(float)
        self.effects = scene["effects"]

    def named(self, effect):
        """The parameters of every effect of this name: a scene has a map of one, a list of several."""
        found = self.effects.get(effect, [])
        return found if isinstance(found, list) else [found]

    def displacement(self):
        return np.linalg.norm(self.now - self.rest, axis=1)

    def stretch(self):
        """The largest principal stretch, the largest singular value of F, as the mean over the tets of
        a vertex, weighted by their volumes."""
        def edges(points):
            corners = points[self.tets]
            return np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)

        gradient = edges(self.now) @ np.linalg.inv(edges(self.rest))
        of_tet = np.linalg.svd(gradient, compute_uv=False)[:, 0]
        volume = np.abs(np.linalg.det(edges(self.rest)))
        total, weight = np.zeros(len(self.rest)), np.zeros(len(self.rest))
        for corner in self.tets.T:
            np.add.at(total, corner, volume * of_tet)
            np.add.at(weight, corner, volume)
        return total / weight


def unit(vector):
    return np.array(vector) / np.linalg.norm(vector)


# --- the body


def grid_of(run, points, values=None):
    grid = vtk.vtkUnstructuredGrid()
    vertices = vtk.vtkPoints()
    vertices.SetData(numpy_to_vtk(points, deep=True))
    grid.SetPoints(vertices)
    grid.Allocate(len(run.tets))
    for tet in run.tets:
        grid.InsertNextCell(vtk.VTK_TETRA, 4, [int(vertex) for vertex in tet])
    labels = numpy_to_vtk(run.labels.astype(np.int32), deep=True)
    labels.SetName("label")
    grid.GetCellData().AddArray(labels)
    if values is not None:
        scalars = numpy_to_vtk(values, deep=True)
        scalars.SetName("value")
        grid.GetPointData().SetScalars(scalars)
    return grid


def result(filter_, data):
    filter_.SetInputData(data)
    filter_.Update()
    return filter_.GetOutput()


def surface_of(grid, with_edges=False):
    normals = vtk.vtkPolyDataNormals()
    normals.SetSplitting(with_edges)
    normals.SetFeatureAngle(50)
    return result(normals, result(vtk.vtkDataSetSurfaceFilter(), grid))


def with_label(grid, label):
    threshold = vtk.vtkThreshold()
    threshold.SetInputArrayToProcess(0, 0, 0, vtk.vtkDataObject.FIELD_ASSOCIATION_CELLS, "label")
    threshold.SetLowerThreshold(label)
    threshold.SetUpperThreshold(label)
    return result(threshold, grid)


def plane_at(cut):
    plane = vtk.vtkPlane()
    plane.SetOrigin(cut["point"])
    plane.SetNormal(cut["normal"])
    return plane


def behind(cut, before=0.0):
    """The plane with its normal into what stays, moved by so many mm towards what does not."""
    normal = unit(cut["normal"])
    return plane_at({"point": np.array(cut["point"]) + before * normal, "normal": -normal})


def cut_away(grid, cut):
    """What lies before the plane, on the side of its normal, is left out."""
    clip = vtk.vtkClipDataSet()
    clip.SetClipFunction(plane_at(cut))
    clip.InsideOutOn()
    return result(clip, grid)


def solid_behind(shape, cut):
    """What of a closed surface lies behind the plane, closed there. Its face stands a little before that
    of the body: between the vertices that an obstacle holds off, triangles reach into it."""
    planes = vtk.vtkPlaneCollection()
    planes.AddItem(behind(cut, GAP))
    clip = vtk.vtkClipClosedSurface()
    clip.SetClippingPlanes(planes)
    clip.SetScalarModeToNone()
    return surface_of(result(clip, result(vtk.vtkCleanPolyData(), shape)), with_edges=True)


def outline_of(grid, cut):
    """Where the surface of a part meets the plane of the cut."""
    cutter = vtk.vtkCutter()
    cutter.SetCutFunction(plane_at(cut))
    return result(cutter, result(vtk.vtkDataSetSurfaceFilter(), grid))


# --- what is drawn


def actor_of(data, color, opacity=1.0):
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(data)
    mapper.ScalarVisibilityOff()
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    look = actor.GetProperty()
    look.SetColor(color)
    look.SetOpacity(opacity)
    look.SetInterpolationToPhong()
    look.SetAmbient(0.1)
    look.SetSpecular(0.12)
    look.SetSpecularPower(25)
    return actor


def scale_of(low, high):
    colors = vtk.vtkColorTransferFunction()
    for i, (red, green, blue) in enumerate(SCALE):
        colors.AddRGBPoint(low + (high - low) * i / (len(SCALE) - 1), red, green, blue)
    return colors


def color_by(actor, colors, low, high):
    mapper = actor.GetMapper()
    mapper.SetLookupTable(colors)
    mapper.SetScalarRange(low, high)
    mapper.ScalarVisibilityOn()


def lines_of(data, color, width):
    actor = actor_of(data, color)
    actor.GetProperty().SetLineWidth(width)
    actor.GetProperty().LightingOff()
    return actor


def in_ink(words):
    words.SetColor(INK)
    words.SetFontSize(15)
    words.ShadowOff()
    words.ItalicOff()
    words.BoldOff()


def words_at(text, x, y):
    actor = vtk.vtkTextActor()
    actor.SetInput(text)
    actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
    actor.SetPosition(x, y)
    in_ink(actor.GetTextProperty())
    return actor


def legend_of(colors, title, time):
    """The strip under the picture: the time, the scale and what it is of."""
    scale = vtk.vtkScalarBarActor()
    scale.SetLookupTable(colors)
    scale.SetNumberOfLabels(3)
    scale.SetLabelFormat("%g")
    scale.SetOrientationToHorizontal()
    scale.UnconstrainedFontSizeOn()
    in_ink(scale.GetLabelTextProperty())
    scale.SetPosition(0.6, 0.1)
    scale.SetWidth(0.37)
    scale.SetHeight(0.85)
    strip = vtk.vtkRenderer()
    strip.SetBackground(PAPER)
    strip.SetViewport(0, 0, 1, STRIP)
    for actor in [scale, words_at(f"t = {time:.2f} s", 0.02, 0.35), words_at(title, 0.3, 0.35)]:
        strip.AddActor2D(actor)
    return strip


# --- obstacles


def plate(point, normal, reach):
    """A square of a plane, `reach` mm to each side of a point."""
    source = vtk.vtkPlaneSource()
    source.SetOrigin(-reach, -reach, 0)
    source.SetPoint1(reach, -reach, 0)
    source.SetPoint2(-reach, reach, 0)
    source.SetNormal(normal)
    source.SetCenter(point)
    source.Update()
    return source.GetOutput()


def ball(center, radius):
    source = vtk.vtkSphereSource()
    source.SetCenter(center)
    source.SetRadius(radius)
    source.SetThetaResolution(48)
    source.SetPhiResolution(32)
    source.Update()
    return source.GetOutput()


def rod(start, end, radius):
    line = vtk.vtkLineSource()
    line.SetPoint1(start)
    line.SetPoint2(end)
    tube = vtk.vtkTubeFilter()
    tube.SetInputConnection(line.GetOutputPort())
    tube.SetRadius(radius)
    tube.SetNumberOfSides(48)
    tube.CappingOn()
    whole = vtk.vtkAppendPolyData()
    whole.AddInputConnection(tube.GetOutputPort())
    for point in [start, end]:
        whole.AddInputData(ball(point, radius))
    whole.Update()
    return whole.GetOutput()


def block(center, size, rotation):
    source = vtk.vtkCubeSource()
    source.SetXLength(size[0])
    source.SetYLength(size[1])
    source.SetZLength(size[2])
    turn = vtk.vtkTransform()
    turn.Translate(center)
    angle = np.linalg.norm(rotation)
    if angle > 0:
        turn.RotateWXYZ(math.degrees(angle), rotation)
    moved = vtk.vtkTransformPolyDataFilter()
    moved.SetInputConnection(source.GetOutputPort())
    moved.SetTransform(turn)
    moved.Update()
    return moved.GetOutput()


def moved(run, point, params):
    """Where an obstacle has carried a point of its own, m, to by the time of the frame, mm."""
    under_way = max(min(run.time, params["stop"]) - params["start"], 0.0)
    return MM_PER_M * (np.array(point) + under_way * np.array(params["velocity"]))


def floors_of(run):
    """Planes, seen from the body's side only: one before the body does not hide it."""
    middle = (run.rest.min(axis=0) + run.rest.max(axis=0)) / 2
    reach = 0.75 * np.linalg.norm(run.rest.max(axis=0) - run.rest.min(axis=0))
    planes = []  # a point and the unit normal
    for params in run.named("ground"):
        normal = unit(params["normal"])
        height = (run.rest @ normal).min() - MM_PER_M * params["clearance"]
        planes.append((height * normal, normal))
    for params in run.named("plane"):
        planes.append((moved(run, params["point"], params), unit(params["normal"])))
    actors = []
    for point, normal in planes:
        below = middle - np.dot(middle - point, normal) * normal
        actor = actor_of(plate(below, normal, reach), FLOOR)
        actor.GetProperty().BackfaceCullingOn()
        actor.GetProperty().SetAmbient(0.55)
        actor.GetProperty().SetDiffuse(0.45)
        actors.append(actor)
    return actors


def tools_of(run, cut):
    """The other obstacles, and the hand of a grip: a ball where it has led the point that it holds."""
    actors = []

    def add(shape, opacity=1.0):
        actors.append(actor_of(solid_behind(shape, cut) if cut else shape, STEEL, opacity))

    for params in run.named("sphere"):
        add(ball(moved(run, params["center"], params), MM_PER_M * params["radius"]))
    for params in run.named("capsule"):
        ends = [moved(run, params[end], params) for end in ["from", "to"]]
        add(rod(*ends, MM_PER_M * params["radius"]))
    for params in run.named("box"):
        add(block(moved(run, params["center"], params), MM_PER_M * np.array(params["size"]),
                  np.array(params["rotation"])), 0.35)
    for params in run.named("grip"):
        held = MM_PER_M * (np.array(params["point"]) + np.array(params["offset"]))
        add(ball(held, MM_PER_M * params["radius"]), 0.2)
    return actors


# --- the picture

# Title, least value, step of the scale's end, and the values of the vertices.
MEASURES = {"displacement": ("displacement, mm", 0.0, 10.0, Run.displacement),
            "stretch": ("largest principal stretch", 1.0, 0.1, Run.stretch)}


def draw(folder, scene, view, picture):
    """Writes a PNG. `folder` is that of a simulation, `scene` its scene.json, and `view` says what is
    seen: `from` (the direction to look from, LPS), `color` (a key of MEASURES), and where they are
    given `time` (s), `up` (LPS), `zoom`, `up_to` (the end of the scale), `ghost` (false: without the
    body at rest), `cut` (a point, mm, and the normal of what is left out) and `outlined` (labels whose
    outlines are drawn in the cut)."""
    run = Run(folder, scene, view.get("time"))
    title, low, step, measure = MEASURES[view["color"]]
    values = measure(run)
    high = view.get("up_to", low + step * max(math.ceil((values.max() - low) / step), 1))
    if values.max() > high:
        title += ", cut"
    colors = scale_of(low, high)
    cut = view.get("cut")

    renderer = vtk.vtkRenderer()
    renderer.SetBackground(PAPER)
    renderer.SetViewport(0, STRIP, 1, 1)
    grid = grid_of(run, run.now, values)
    body = actor_of(surface_of(cut_away(grid, cut), with_edges=True) if cut else surface_of(grid), PAPER)
    color_by(body, colors, low, high)
    renderer.AddActor(body)
    if view.get("ghost", True):
        ghost = actor_of(surface_of(grid_of(run, run.rest)), STEEL, 0.15)
        if cut:
            ghost.GetMapper().AddClippingPlane(behind(cut))
        ghost.GetProperty().BackfaceCullingOn()
        # Behind the body where they coincide, which is where the body has not moved.
        ghost.GetMapper().SetResolveCoincidentTopologyToPolygonOffset()
        ghost.GetMapper().SetRelativeCoincidentTopologyPolygonOffsetParameters(0.0, 2000.0)
        renderer.AddActor(ghost)
    for label in view.get("outlined", []):
        renderer.AddActor(lines_of(outline_of(with_label(grid, int(run.label_ids[label])), cut), INK, 2.5))

    camera = renderer.GetActiveCamera()
    camera.ParallelProjectionOn()
    camera.SetFocalPoint(0, 0, 0)
    camera.SetPosition(view["from"])
    camera.SetViewUp(view.get("up", [0, 0, 1]))
    renderer.ResetCamera()  # on the body, now and at rest; planes reach beyond the picture
    camera.Zoom(1.3 * view.get("zoom", 1.0))
    for obstacle in floors_of(run) + tools_of(run, cut):
        renderer.AddActor(obstacle)
    renderer.ResetCameraClippingRange()
    renderer.SetUseDepthPeeling(True)
    renderer.SetUseFXAA(True)
    vtk.vtkLightKit().AddLightsToRenderer(renderer)

    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetAlphaBitPlanes(True)  # for the depth peeling, which cannot have several samples a pixel
    window.SetMultiSamples(0)
    window.SetSize(SIZE)
    window.AddRenderer(renderer)
    window.AddRenderer(legend_of(colors, title, run.time))
    window.Render()
    image = vtk.vtkWindowToImageFilter()
    image.SetInput(window)
    image.ReadFrontBufferOff()
    writer = vtk.vtkPNGWriter()
    writer.SetInputConnection(image.GetOutputPort())
    writer.SetCompressionLevel(9)
    writer.SetFileName(str(picture))
    writer.Write()
