"""Pictures of the gallery of a body of one tetrahedron: every obstacle, a cut and the shadow are seen.

    gallery_picture.py FOLDER

Needs VTK, h5py and a display. Writes to FOLDER; ends with an assertion where a picture lacks something.
"""
import pathlib
import sys

import h5py
import numpy as np
import vtk
from vtk.util.numpy_support import vtk_to_numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "docs/site/gallery"))
import draw  # noqa: E402

FOLDER = pathlib.Path(sys.argv[1])
STILL = {"velocity": [0, 0, 0], "start": 0, "stop": 1e9}
OBSTACLES = {"ground": {"normal": [0, 0, 1], "clearance": 0.01},
             "plane": [{"point": [-0.02, 0, 0], "normal": [1, 0, 0]} | STILL] * 2,
             "sphere": {"center": [0.1, 0, 0], "radius": 0.02} | STILL,
             "capsule": {"from": [0, 0, 0.1], "to": [0.1, 0, 0.1], "radius": 0.02} | STILL,
             "box": {"center": [0.1, 0, 0], "size": [0.05, 0.05, 0.05], "rotation": [0, 0.5, 0]} | STILL,
             "grip": {"point": [0, 0, 0], "offset": [0, 0, 0.1], "radius": 0.05}}
MOVING = {"sphere": OBSTACLES["sphere"] | {"velocity": [-0.05, 0, 0], "start": 0.2, "stop": 0.6}}


def pixels(name, effects, **view):
    """Those above the legend, as rows of red, green and blue."""
    scene = {"effects": effects}
    draw.draw(FOLDER, scene, {"from": [0.3, -1, 0.4], "color": "stretch", "ghost": False} | view, FOLDER / name)
    reader = vtk.vtkPNGReader()
    reader.SetFileName(str(FOLDER / name))
    reader.Update()
    image = reader.GetOutput()
    assert image.GetDimensions()[:2] == draw.SIZE
    legend = int(draw.STRIP * draw.SIZE[1]) + 1
    return vtk_to_numpy(image.GetPointData().GetScalars())[draw.SIZE[0] * legend:]


def differing(one, other):
    return (one != other).any(axis=1).mean()


with h5py.File(FOLDER / "trajectory.h5", "w") as file:
    rest = 50.0 * np.vstack([np.zeros(3), np.eye(3)])
    file["points"], file["tets"] = rest, np.array([[0, 1, 2, 3]])
    file["labels"], file["label_ids"], file["label_names"] = [1], [1], ["liver"]
    file["times"], file["positions"] = [0.0, 1.0], np.stack([rest, 2 * rest + [30, 0, 0]])

end = draw.Run(FOLDER, {"effects": {}})
assert np.allclose(end.stretch(), 2) and np.allclose(end.displacement(), [30, 80, 3400 ** 0.5, 3400 ** 0.5])
assert draw.Run(FOLDER, {"effects": {}}, 0.2).time == 0
at = draw.moved(end, [0.1, 0, 0], MOVING["sphere"])
assert np.allclose(at, [80, 0, 0]), at

alone = pixels("alone.png", {})
assert 0.02 < differing(alone, np.full_like(alone, 255)) < 0.9
for effect, params in OBSTACLES.items():
    assert differing(alone, pixels(effect + ".png", {effect: params})) > 0.005, effect
assert differing(pixels("sphere.png", {"sphere": OBSTACLES["sphere"]}), pixels("moving.png", MOVING)) > 0.005
assert differing(alone, pixels("ghost.png", {}, ghost=True)) > 0.005
cut = {"point": [0, 5, 0], "normal": [0, -1, 0]}
opened = pixels("cut.png", {}, cut=cut)
assert differing(alone, opened) > 0.005
assert differing(opened, pixels("outlined.png", {}, cut=cut, outlined=["liver"])) > 0.0005
for effect, params in OBSTACLES.items():
    assert differing(opened, pixels(effect + "_cut.png", {effect: params}, cut=cut)) > 0.005, effect
# What is left of a tool is closed, and reaches from just before the cut to its own end.
for shape in [draw.ball([0, 0, 0], 20), draw.rod([0, 0, 0], [40, 0, 0], 20),
              draw.block([0, 0, 0], [40, 40, 40], np.zeros(3))]:
    half = draw.solid_behind(shape, cut)
    least, greatest = half.GetBounds()[2:4]
    assert abs(least - (5 - draw.GAP)) < 0.01 and abs(greatest - 20) < 0.5, half.GetBounds()
    edges = vtk.vtkFeatureEdges()
    edges.FeatureEdgesOff()
    edges.ManifoldEdgesOff()
    edges.NonManifoldEdgesOff()
    assert draw.result(edges, draw.result(vtk.vtkCleanPolyData(), half)).GetNumberOfCells() == 0, "it is open"
