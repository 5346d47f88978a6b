"""Meshes and simulations as the objects of other libraries, which need only be there when they are asked for."""

import importlib
import os
import pathlib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ._viscera import TetMesh

if TYPE_CHECKING:
    from . import Simulation
    from ._preparation import Surface

TETRA, TRIANGLE = 10, 5  # VTK's numbers of cell types


def _array(values: NDArray[Any], deep: bool = False) -> Any:
    return importlib.import_module("vtkmodules.util.numpy_support").numpy_to_vtk(values, deep=deep)


def _set_points(data: Any, points: NDArray[np.float64]) -> None:
    places = importlib.import_module("vtkmodules.vtkCommonCore").vtkPoints()
    places.SetData(_array(points))
    data.SetPoints(places)


def _cells(corners: NDArray[np.int32]) -> Any:
    count, size = corners.shape
    cells = importlib.import_module("vtkmodules.vtkCommonDataModel").vtkCellArray()
    offsets = np.arange(count + 1, dtype=np.int64) * size
    cells.SetData(_array(offsets, deep=True), _array(corners.astype(np.int64).ravel(), deep=True))
    return cells


def _add(to: Any, arrays: Mapping[str, NDArray[Any]]) -> None:
    for name, values in arrays.items():
        array = _array(values.view(np.uint8) if values.dtype == np.bool_ else values)
        array.SetName(name)
        to.AddArray(array)


def _grid(mesh: TetMesh, points: NDArray[np.float64]) -> Any:
    grid = importlib.import_module("vtkmodules.vtkCommonDataModel").vtkUnstructuredGrid()
    _set_points(grid, points)
    grid.SetCells(TETRA, _cells(mesh.tets))
    _add(grid.GetCellData(), {"label": mesh.labels, **mesh.cell_data, **mesh.regions})
    return grid


def mesh_to_vtk(mesh: TetMesh) -> Any:
    """A vtkUnstructuredGrid, LPS mm, with the cell arrays label, those of cell_data and a flag a region."""
    return _grid(mesh, mesh.points)


def surface_to_vtk(surface: "Surface") -> Any:
    """A vtkPolyData, LPS mm, with the cell array label."""
    data = importlib.import_module("vtkmodules.vtkCommonDataModel").vtkPolyData()
    _set_points(data, surface.points)
    data.SetPolys(_cells(surface.triangles))
    _add(data.GetCellData(), {"label": surface.labels})
    return data


def simulation_to_vtk(simulation: "Simulation") -> Any:
    """The body as it is now, LPS mm, with its displacement (m) and velocity (m/s) at the points."""
    grid = _grid(simulation.mesh, simulation.positions)
    _add(grid.GetPointData(), {"displacement": simulation.displacements, "velocity": simulation.velocities})
    return grid


class VtuSeries:
    """A body over time as a .vtu file a frame, and beside them NAME.pvd, which opens all of them in ParaView and PyVista.

        series = viscera.bridges.VtuSeries("falling.pvd")
        while simulation.time < 1.0:
            simulation.step()
            series.add(simulation)

    The frames' files stand in the folder NAME and replace those of an earlier series. The .pvd file names those that are
    there whenever it is read. For a run that has ended see trajectory_to_vtu.
    """

    def __init__(self, file: str | os.PathLike[str]) -> None:
        self.file = pathlib.Path(file)
        if self.file.suffix != ".pvd":
            raise ValueError(f"file: {self.file}, allowed: a name that ends in .pvd")
        self.folder = self.file.with_suffix("")
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.glob("*.vtu"):
            old.unlink()
        self._frames: list[str] = []
        self._write_names()

    def add(self, simulation: "Simulation") -> None:
        """The body as it is now, as to_vtk() gives it."""
        self.add_grid(simulation_to_vtk(simulation), simulation.time)

    def add_grid(self, grid: Any, time: float) -> None:
        """Any vtkUnstructuredGrid of the time, s."""
        name = f"{len(self._frames):05d}.vtu"
        writer = importlib.import_module("vtkmodules.vtkIOXML").vtkXMLUnstructuredGridWriter()
        writer.SetFileName(os.fspath(self.folder / name))
        writer.SetInputData(grid)
        if not writer.Write():
            raise OSError(f"{self.folder / name}: cannot be written")
        self._frames.append(f'<DataSet timestep="{time!r}" file="{self.folder.name}/{name}"/>')
        self._write_names()

    def _write_names(self) -> None:
        rows = "".join(f"    {frame}\n" for frame in self._frames)
        whole = self.file.with_suffix(".pvd.part")
        whole.write_text(f'<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n{rows}'
                         "  </Collection>\n</VTKFile>\n", encoding="utf-8")
        whole.replace(self.file)


def trajectory_to_vtu(run: str | os.PathLike[str], file: str | os.PathLike[str]) -> int:
    """The frames of a run that has ended as a VtuSeries: how many there are.

    run: the folder of `viscera-simulate`, with its trajectory.h5. Points are LPS mm; they have their displacement from
    rest, mm, and tets their label. Needs h5py and VTK's Python.
    """
    series = VtuSeries(file)
    with importlib.import_module("h5py").File(pathlib.Path(run) / "trajectory.h5") as trajectory:
        rest, tets, labels = (trajectory[name][:] for name in ("points", "tets", "labels"))
        mesh = TetMesh(rest, tets, labels)
        for time, positions in zip(trajectory["times"][:], trajectory["positions"], strict=True):
            grid = _grid(mesh, positions.astype(np.float64))
            _add(grid.GetPointData(), {"displacement": positions - rest})
            series.add_grid(grid, float(time))
        return len(trajectory["times"])


def mesh_to_meshio(mesh: TetMesh) -> Any:
    """A meshio.Mesh, LPS mm, with the cell arrays label, those of cell_data and a flag a region."""
    arrays: dict[str, NDArray[Any]] = {"label": mesh.labels, **mesh.cell_data}
    arrays |= {name: inside.astype(np.uint8) for name, inside in mesh.regions.items()}
    return importlib.import_module("meshio").Mesh(
        mesh.points, [("tetra", mesh.tets)], cell_data={name: [values] for name, values in arrays.items()})


def mesh_from_meshio(mesh: Any, names: Mapping[int, str] | None = None, label: str = "label") -> TetMesh:
    """The tets of a meshio.Mesh, LPS mm; `label` is the cell array with their materials, 1 where there is none."""
    blocks = [k for k, block in enumerate(mesh.cells) if block.type == "tetra"]
    if not blocks:
        raise ValueError(f"cells: {sorted({block.type for block in mesh.cells})}, allowed: some of type tetra")
    tets = np.concatenate([mesh.cells[k].data for k in blocks])
    labels = np.concatenate([mesh.cell_data[label][k] for k in blocks]) if label in mesh.cell_data else None
    # What cells of other types alone use is not the body's.
    used, numbers = np.unique(tets, return_inverse=True)
    return TetMesh(mesh.points[used], numbers.reshape(tets.shape), labels, names or {})
