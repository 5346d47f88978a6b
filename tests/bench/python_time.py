"""From an array of ids to the positions of a simulation, in one Python process and by the programs with their files.

python_time.py BIN TETS FRAMES: each way three times, by turns; a line of CSV each, and the ratio of the medians. Then what
a call of sim.step() costs beyond its frame.
"""

import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import viscera

SCENE = "configs/scenes/drop.yaml"
MATERIALS = {"liver": 1, "tumour": 2, "vessels": 3}


def in_python(voxels, spacing, direction, tets, frames):
    labels = viscera.read_labels(voxels, spacing, direction=direction, labels=MATERIALS)
    mesh = labels.tet_mesh(target_tets=tets)
    sim = viscera.Simulation(mesh, SCENE)
    sim.step(frames)
    return sim.positions, sim.state_hash


def by_programs(volume, bin, tets, frames):
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder)

        def run(stage, *words):
            # Gates may fail: the run is over before the body rests.
            command = [bin / f"viscera-{stage}", *words, "--out", out / stage, "--quiet"]
            assert subprocess.run(command, capture_output=True).returncode in (0, 5)

        run("labels", "--in", f"volume={volume}", "--set", "labels={liver: 1, tumour: 2, vessels: 3}")
        run("tetmesh", "--in", f"labels={out / 'labels/labels.nrrd'}", "--set", f"target_tets={tets}")
        run("simulate", "--in", f"mesh={out / 'tetmesh/mesh.vtu'}", "--in", f"scene={SCENE}",
            "--set", f"end={(frames - 0.5) / 60:.9f} s")
        last = (out / "simulate/metrics.csv").read_text().splitlines()
        return last[-1].split(",")[last[0].split(",").index("state_hash")]


def call_us(calls=2000):
    """Of one tet, whose frame takes microseconds: frames by one call each less as many by one call, medians of five."""
    points = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]])
    scene = {"scene": 1, "materials": {"liver": {"E": "5 kPa", "nu": 0.45, "density": "1060 kg/m3"}},
             "effects": {"neo_hookean": None}, "time": {"frame_rate": "60 Hz", "substeps": 1, "end": "1 s"}}
    sim = viscera.Simulation(viscera.TetMesh(points, [[0, 1, 2, 3]], names={1: "liver"}), scene, threads=1)

    def seconds(work):
        begin = time.perf_counter()
        work()
        return time.perf_counter() - begin

    def one_by_one():
        for _ in range(calls):
            sim.step()

    apart = statistics.median(seconds(one_by_one) for _ in range(5))
    together = statistics.median(seconds(lambda: sim.step(calls)) for _ in range(5))
    return 1e6 * (apart - together) / calls, 1e6 * together / calls


def main():
    bin, tets, frames = pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
    # What the phantom's own array is: as the programs read it.
    labels = viscera.read_labels("sample_data/phantom.nrrd", labels=MATERIALS)
    times = {"python": [], "programs": []}
    with tempfile.TemporaryDirectory() as folder:
        volume = pathlib.Path(folder) / "volume.nrrd"
        axes = (np.array(labels.direction).reshape(3, 3) * labels.spacing).T
        header = ("NRRD0004\ntype: unsigned char\ndimension: 3\nspace: left-posterior-superior\n"
                  f"sizes: {' '.join(str(n) for n in labels.voxels.shape[::-1])}\nspace directions: "
                  + " ".join("(" + ",".join(repr(float(x)) for x in axis) + ")" for axis in axes)
                  + "\nkinds: domain domain domain\nencoding: raw\nspace origin: (0,0,0)\n\n")
        volume.write_bytes(header.encode() + labels.voxels.astype(np.uint8).tobytes())
        print("way,seconds")
        for _ in range(3):
            begin = time.perf_counter()
            _, in_memory = in_python(labels.voxels, labels.spacing, labels.direction, tets, frames)
            times["python"].append(time.perf_counter() - begin)
            begin = time.perf_counter()
            written = by_programs(volume, bin, tets, frames)
            times["programs"].append(time.perf_counter() - begin)
            for way, seconds in times.items():
                print(f"{way},{seconds[-1]:.2f}", flush=True)
    same = "the same bits" if in_memory == written else f"other bits: {in_memory}, {written}"
    ratio = statistics.median(times["python"]) / statistics.median(times["programs"])
    print(f"{tets} tets, {frames} frames: Python takes {ratio:.3f} of the programs' time; {same}")
    print("a call of sim.step() takes {:.1f} us more than its frame, which of one tet takes {:.1f}".format(*call_us()))


main()
