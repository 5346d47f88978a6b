"""How long displacements and velocities take to be at hand in Python after a frame on a device: in its own memory, for
libraries that work there, and in the host's. A table, microseconds.

    PYTHONPATH=tests/python python tests/bench/device_motion.py > device_motion.csv
"""

import statistics
import time

import viscera
from conftest import cube, falling

FRAMES = 200


def microseconds(simulation, look):
    times = []
    for _ in range(FRAMES):
        simulation.step()
        begin = time.perf_counter()
        look()
        times.append(1e6 * (time.perf_counter() - begin))
    q1, median, q3 = statistics.quantiles(times, n=4)
    return f"{q1:.1f},{median:.1f},{q3:.1f}"


print("tets,vertices,scheme,where,q1_us,median_us,q3_us")
for cells in (12, 20):
    mesh = viscera.TetMesh(*cube(cells), names={1: "liver"})
    simulation = viscera.Simulation(mesh, falling(), device="cuda", scheme="block_gauss_seidel")
    simulation.step(5)
    for where, look in {"device": simulation.motion_on_device, "host": lambda: simulation.displacements}.items():
        print(f"{len(mesh.tets)},{len(mesh.points)},{simulation.scheme},{where},{microseconds(simulation, look)}",
              flush=True)
