"""Soft-tissue simulation of segmented anatomy.

    import viscera

    labels = viscera.read_labels("liver.nii.gz")        # or an array of ids and its spacing
    mesh = labels.tet_mesh(cell_size="5 mm")            # or labels.surface().tet_mesh(...)
    sim = viscera.Simulation(mesh, "configs/scenes/drop.yaml")
    sim.step(10)
    sim.positions            # [n, 3] LPS mm

    viscera.run("configs/liver.yaml", {"input": "liver.nii.gz"})   # a spec, as the program `viscera` runs it

Each step gives the bits that the program of its stage gives with the same input and params. Lengths
of volumes, meshes and positions are in mm, all else in SI units. Errors are `viscera.Error`.
"""

import contextlib
import json
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from . import _viscera, bridges
from ._viscera import Error, TetMesh, __version__, read_mesh
from .bridges import mesh_from_meshio
from .programs import estimate, measured, run

if TYPE_CHECKING:
    from .labels import Labels, Surface, read_labels
    from .reports import Report, report
    from .studies import study

__all__ = ["Error", "Labels", "Report", "Simulation", "Surface", "TetMesh", "__version__", "estimate", "measured",
           "mesh_from_meshio", "read_labels", "read_mesh", "report", "run", "study"]


# s, as of a scene.
MAX_TIME = 1e5


def __getattr__(name: str) -> Any:
    # Only for those who ask: they load the libraries of images and meshing.
    if name in ("Labels", "Surface", "read_labels"):
        from . import labels

        return getattr(labels, name)
    if name in ("Report", "report"):
        from . import reports

        return getattr(reports, name)
    if name == "study":  # made of simulations, which are made below
        from . import studies

        return studies.study
    raise AttributeError(f"module 'viscera' has no attribute '{name}'")


class Simulation(_viscera.Simulation):
    """A body in a scene, frame by frame.

    mesh: a TetMesh. scene: the path of a scene.yaml, or its content as a dict. params: those of
    `viscera-simulate` by name, as in device="cuda", solver="fem", substeps=128, forces=True,
    end="2 s", change={"materials.liver.E": "7 kPa"}, probes={"tip": {"point": ["0 mm", ...]}}.

    Of one simulation one thread at a time may ask; different ones are independent. Long calls let
    other threads run, and Ctrl-C ends them between two frames.

    displacements, velocities: [n, 3] views of the state, m and m/s, not copied and not writable;
        they stay as they are when the simulation goes on. positions: [n, 3], LPS mm.
    stress: [tets, 3, 3] Cauchy stress of now without viscosity, Pa. forces: [n, 3] what materials,
        springs, pressures and loads do to each vertex now, N, without what depends on velocities.
    motion_on_device(): displacements and velocities on a CUDA device, [n, 3] m and m/s, where the solver has them: each a
        DeviceArray for torch.from_dlpack, cupy.from_dlpack or warp.array, of float32 unless precision="fp64". They are
        those of now, until the simulation goes on.
    gates, metrics, caveats: what the last run() came to, as in the manifest of the program; none once it has gone on.
    certified: what certify() has said of now; None: it has not been asked.
    mesh: as given. time: s. frame: how many are done. frame_time: s. loads_end: s, when nothing that loads or leads
        the body changes any more (inf: never). substeps: of a frame, as the scene's policy has raised them. device,
        scheme: what it runs on, and how. state_hash: as in metrics.csv.
    """

    _is_made = False  # tracebacks show objects whose making was refused, too

    def __init__(self, mesh: TetMesh, scene: str | os.PathLike[str] | Mapping[str, Any], **params: Any) -> None:
        self.mesh = mesh
        self.certified: dict[str, Any] | None = None
        with file_of(scene) as file:
            super().__init__(mesh, file, params)
        self._is_made = True

    def step(self, frames: int = 1) -> None:
        """Goes on by whole frames."""
        if frames < 0:
            raise ValueError(f"frames: {frames}, allowed: 0 or more")
        self.certified = None
        super().step(frames)

    def run(self, progress: Callable[[int, float, float], object] | None = None,
            until: float | str | None = "rest") -> dict[str, Any]:
        """Goes on until the body rests, at most to the scene's time (`end`); or until a time in s.

        until: a number goes on to that time whether the body rests or not, beyond the scene's end too.
        progress(frame, time_s, max_speed_m_s) is called after every frame. Returns a dict: `rested`,
        `rest_time_s`, `divergence` (None, or why the run ended early) and `frames`, one dict a frame
        with the columns of metrics.csv: pandas.DataFrame(result["frames"]).
        """
        self.certified = None
        if until is None or until == "rest":
            return super().run(progress)
        if not isinstance(until, (int, float)) or not self.time < until < MAX_TIME:
            raise ValueError(f"until: {until!r}, allowed: \"rest\", or a time in s after {self.time:.6g}, now")
        return super().run(progress, until)

    def diagnose(self) -> dict[str, float]:
        """Energies (J), volume, smallest det F, inverted tets and speeds of now, by name."""
        return super().diagnose()

    def certify(self) -> dict[str, Any]:
        """How far the body at rest is off, by finite elements on its own mesh, as `certify` of `viscera-simulate`.

        Of the state of now, which should be at rest: what it lacks of that is in the solver's part. Lengths in mm,
        root mean squares of the displacement over the body: `total`, which is no less than the true error where
        nothing is known to the contrary, its parts `solver`, `element`, `mesh`, `support` and `surface` (None where
        the mesh does not say how far the labels end from it), and `share`, the total as a part of the displacement.
        `quantities`: the total of each label's centroid and each probe, by name.
        `size_field`: the mesh with the cell sizes at which all tets would have the same part in the error, for
        `labels.tet_mesh(size_field=..., target_tets=...)`. Raises RuntimeError where the error is not known. Where nothing
        but friction holds a body, its place follows from its way there, and is not in the error.
        """
        self.certified = super().certify()
        return self.certified

    def set(self, name: str, value: float) -> None:
        """Gives a number of the scene another value from now on, in its SI unit: "materials.liver.E", 7e3.

        With solver="fem" and a scene without a schedule; what others change on the way stands in the scene.
        """
        self.certified = None
        super().set(name, value)

    def gradient(self, by_displacement: ArrayLike, with_respect_to: Iterable[str]) -> dict[str, float]:
        """How a quantity J of the body at rest changes with numbers of its scene, by the adjoint method.

        by_displacement: [n, 3] dJ/du in the displacements, 1/m. with_respect_to: names of the scene's
        numbers, as in "materials.liver.E", "effects.gravity.acceleration" or
        "effects.prescribed.displacement.z". Returns dJ/dp by name, in J's unit over the SI unit of p.
        One linear system for all names. The equilibrium is that of Newton's method near the state of
        now, whatever the solver; refused where an obstacle touches the body and with pressure.
        """
        return super().gradient(by_displacement, list(with_respect_to))

    def write(self, file: str | os.PathLike[str]) -> None:
        """Writes the body at rest with the supports and loads of the scene's end for another finite element
        program: .inp for CalculiX and Abaqus, .feb for FEBio, as `formats` of `viscera-simulate` does."""
        super().write(file)

    def __repr__(self) -> str:
        if not self._is_made:
            return "<viscera.Simulation, not made>"
        return f"<viscera.Simulation: t {self.time:.3f} s, {self.device}>"

    def to_vtk(self) -> Any:
        """The body as it is now as a vtkUnstructuredGrid (bridges.simulation_to_vtk)."""
        return bridges.simulation_to_vtk(self)

    def _repr_html_(self) -> str:
        from . import pictures

        return pictures.of_simulation(self)


def _mesh_as_html(mesh: TetMesh) -> str:
    from . import pictures

    return pictures.of_mesh(mesh)


# What a notebook shows of it.
setattr(TetMesh, "_repr_html_", _mesh_as_html)
# What the class of the module cannot have of itself.
setattr(TetMesh, "to_vtk", bridges.mesh_to_vtk)
setattr(TetMesh, "to_meshio", bridges.mesh_to_meshio)


@contextlib.contextmanager
def file_of(scene: str | os.PathLike[str] | Mapping[str, Any]) -> Iterator[str]:
    """The path of a scene; one that is given as a dict stands in a file scene.yaml meanwhile."""
    if not isinstance(scene, Mapping):
        yield os.fspath(scene)
        return
    with tempfile.TemporaryDirectory(prefix="viscera-") as folder:
        path = os.path.join(folder, "scene.yaml")
        with open(path, "w", encoding="utf-8") as file:
            json.dump(dict(scene), file)
        yield path
