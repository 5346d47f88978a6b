"""What accuracy costs in time, on one mesh: runs of several settings held against one that is taken for true."""

import os
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import Error, Simulation
from ._viscera import TetMesh

# At rest: Newton's equilibrium of quadratic tets.
QUADRATIC = {"solver": "fem", "fem_time": "quasi_static", "fem_order": 2}
# In motion: so many times the substeps of the finest setting, none of which is then near to it.
FINER = 8
# The exit code of a simulation that diverged.
DIVERGED = 7


def study(mesh: TetMesh, scene: str | os.PathLike[str] | Mapping[str, Any], settings: Sequence[Mapping[str, Any]], *,
          frames: int | None = None, truth: Mapping[str, Any] | None = None,
          progress: Callable[[int, int], object] | None = None) -> list[dict[str, Any]]:
    """What each of some settings costs and how far off it is: pandas.DataFrame(viscera.study(...)).

        viscera.study(mesh, scene, [{"substeps": n, "element": kind} for n in (16, 64) for kind in ("linear", "smoothed")])

    settings: params of Simulation. frames: the error is that after so many frames from the start; without it that at
    rest. truth: the params of the run that the others are held against. By default at rest the equilibrium of quadratic
    tets, so that the error is that of solver and elements; in motion the first setting with 8 times the substeps of the
    finest one, so that it is that of time step and solver. On another mesh the truth would be another: what the mesh itself
    is off is not in it (`Simulation.certify` has it).
    progress(done, of) is called before each run, the truth's first.

    A row each, in their order: the setting; wall_s, of its frames; frame_ms, the mean of a frame; frames; error, the root
    mean square over the vertices of how far it is off as a part of their displacement; error_mm, the same in mm;
    largest_mm, that of the vertex that is farthest off; rested: whether it came to rest within the scene's time, None in
    motion; failed: of a setting that diverges why, and nothing else is known of it. A refused one raises viscera.Error.
    """
    if not settings:
        raise ValueError("settings: none, allowed: one or more")
    if frames is not None and frames < 1:
        raise ValueError(f"frames: {frames}, allowed: 1 or more, or None: at rest")
    told = progress or (lambda done, of: None)
    told(0, len(settings) + 1)
    true = Simulation(mesh, scene, **(truth if truth is not None else _truth(mesh, scene, settings, frames)))
    if failed := _go(true, frames)["failed"]:
        raise RuntimeError(f"truth: {failed}")
    rows: list[dict[str, Any]] = []
    for setting in settings:
        told(len(rows) + 1, len(settings) + 1)
        rows.append({**setting, **_held_against(true.displacements, Simulation(mesh, scene, **setting), frames)})
    return rows


def _truth(mesh: TetMesh, scene: str | os.PathLike[str] | Mapping[str, Any], settings: Sequence[Mapping[str, Any]],
           frames: int | None) -> dict[str, Any]:
    if frames is None:
        return QUADRATIC
    finest = max(Simulation(mesh, scene, **setting).substeps for setting in settings)
    return {**settings[0], "substeps": FINER * finest}


def _go(simulation: Simulation, frames: int | None) -> dict[str, Any]:
    """Whether it rests, where that is asked, or why it failed."""
    try:
        if frames is None:
            result = simulation.run()
            return {"rested": result["rested"], "failed": result["divergence"]}
        simulation.step(frames)
        simulation.diagnose()  # raises where its state is none that a body can be in
    except Error as error:
        if error.exit_code != DIVERGED:
            raise
        return {"rested": None, "failed": str(error)}
    return {"rested": None, "failed": None}


def _held_against(true: NDArray[np.float64], simulation: Simulation, frames: int | None) -> dict[str, Any]:
    begin = time.perf_counter()
    found = _go(simulation, frames)
    wall = time.perf_counter() - begin
    if found["failed"]:
        return {**dict.fromkeys(("wall_s", "frame_ms", "frames", "error", "error_mm", "largest_mm")), **found, "rested": None}
    off = np.linalg.norm(simulation.displacements - true, axis=1)
    rms = float(np.sqrt(np.mean(off**2)))
    size = float(np.sqrt(np.mean(np.sum(true**2, axis=1))))
    return {"wall_s": wall, "frame_ms": 1e3 * wall / simulation.frame, "frames": simulation.frame,
            "error": rms / size if size > 0 else None, "error_mm": 1e3 * rms, "largest_mm": 1e3 * float(off.max()),
            **found}
