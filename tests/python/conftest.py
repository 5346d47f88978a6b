"""Bodies and scenes of the tests. They run on an installed wheel, beside the programs of BIN."""

import gzip
import os
import pathlib
import subprocess

import numpy as np
import pytest
import viscera

PROGRAMS = pathlib.Path(os.environ.get("VISCERA_BIN", "build/bin"))


def resident_kb():
    """Memory of this process now: not the most that it ever had, which hides what grows below it."""
    return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") // 1024


def cube(cells=3, edge=50.0):
    """Points (mm) and tets of a cube, six tets a cell (Kuhn)."""
    n = cells + 1
    points = np.array([[x, y, z] for z in range(n) for y in range(n) for x in range(n)], float)
    tets = []
    axes = [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)]
    for z in range(cells):
        for y in range(cells):
            for x in range(cells):
                for k, order in enumerate(axes):
                    corner = np.array([x, y, z])
                    tet = [corner.copy()]
                    for axis in order:
                        corner = corner + np.eye(3, dtype=int)[axis]
                        tet.append(corner)
                    numbers = [(p[2] * n + p[1]) * n + p[0] for p in tet]
                    if k >= 3:
                        numbers[2], numbers[3] = numbers[3], numbers[2]
                    tets.append(numbers)
    return points * (edge / cells), np.array(tets, np.int32)


def ball(voxels=20, radius=6.0):
    """Ids [k, j, i]: 1 inside, of a ball in the middle."""
    k, j, i = (axis - (voxels - 1) / 2 for axis in np.ogrid[:voxels, :voxels, :voxels])
    return (k**2 + j**2 + i**2 < radius**2).astype(np.uint8)


def falling(**more):
    """A scene of one material without obstacles."""
    return {
        "scene": 1,
        "materials": {
            "liver": {"E": "5 kPa", "nu": 0.45, "density": "1060 kg/m3", "damping": "20 ms"}
        },
        "effects": {"neo_hookean": None, "gravity": {}, "viscosity": None, **more},
        "time": {"frame_rate": "60 Hz", "substeps": 32, "end": "0.5 s"},
    }


@pytest.fixture
def mesh():
    return viscera.TetMesh(*cube(), names={1: "liver"})


def read_nrrd(file):
    """A label volume in LPS: ids [k, j, i], spacing, origin (mm) and direction as viscera has them."""
    header, data = pathlib.Path(file).read_bytes().split(b"\n\n", 1)
    fields = dict(line.split(": ", 1) for line in header.decode().splitlines() if ": " in line)
    assert fields["space"] == "left-posterior-superior"
    size = [int(n) for n in fields["sizes"].split()]
    axes = np.array([[float(x) for x in v[1:-1].split(",")] for v in fields["space directions"].split()])
    spacing = np.linalg.norm(axes, axis=1)
    origin = [float(x) for x in fields["space origin"][1:-1].split(",")]
    if fields["encoding"] in ("gz", "gzip"):
        data = gzip.decompress(data)
    voxels = np.frombuffer(data, {"unsigned char": "u1", "unsigned short": "u2"}[fields["type"]])
    return voxels.reshape(size[::-1]), list(spacing), origin, list((axes.T / spacing).ravel())


@pytest.fixture(scope="session")
def demo(tmp_path_factory):
    """The demo's phantom in large tets: the folder of its stages."""
    out = tmp_path_factory.mktemp("demo")
    subprocess.run(
        [PROGRAMS / "viscera", "run", "configs/demo.yaml", "--until", "tetmesh", "--quiet",
         "--set", "tetmesh.cell_size=14mm", "--out", out],
        check=True,
    )
    return out / "demo"
