"""From an array of ids to the stress of a body at rest: what a type checker must understand of it."""

import numpy as np
import viscera
from numpy.typing import NDArray


def ball(voxels: int, radius: float) -> NDArray[np.uint8]:
    k, j, i = (axis - (voxels - 1) / 2 for axis in np.ogrid[:voxels, :voxels, :voxels])
    return np.asarray(k**2 + j**2 + i**2 < radius**2, dtype=np.uint8)


def main() -> None:
    labels = viscera.read_labels(ball(24, 9.0), spacing=(2.0, 2.0, 2.0), names={1: "liver"})
    mesh = labels.tet_mesh(cell_size="6 mm")
    assert all(gate["passed"] for gate in mesh.gates), mesh.gates
    scene = {
        "scene": 1,
        "materials": {"liver": {"E": "5 kPa", "nu": 0.45, "density": "1060 kg/m3", "damping": "20 ms"}},
        "effects": {"neo_hookean": None, "gravity": {}, "viscosity": None, "fixed": {"side": "superior",
                                                                                       "within": "8 mm"}},
        "time": {"frame_rate": "60 Hz", "end": "4 s"},
    }
    simulation = viscera.Simulation(mesh, scene)
    result = simulation.run()
    assert result["rested"]
    lowest = int(mesh.points[:, 2].argmin())
    sag = float(simulation.displacements[lowest, 2])
    largest = float(np.linalg.norm(simulation.stress, axis=(1, 2)).max())
    print(f"sag {1e3 * sag:.2f} mm, largest stress {1e-3 * largest:.2f} kPa")


if __name__ == "__main__":
    main()
