"""What a simulation in Python gives, against the programs and closed forms."""

import csv
import os
import resource
import signal
import subprocess
import threading
import time

import numpy as np
import pytest
import viscera
from conftest import PROGRAMS, cube, falling


def test_a_body_that_nothing_holds_falls_as_galilei_says(mesh):
    sim = viscera.Simulation(mesh, falling())
    sim.step(15)
    assert sim.frame == 15
    assert sim.time == pytest.approx(0.25)
    # To second order in time, but for the first substep, which is taken by backward Euler.
    expected = -0.5 * 9.80665 * sim.time**2
    np.testing.assert_allclose(sim.displacements[:, 2], expected, rtol=5e-3)
    np.testing.assert_allclose(sim.displacements[:, :2], 0.0, atol=1e-6)
    moved = sim.positions - mesh.points
    np.testing.assert_allclose(moved, 1e3 * sim.displacements, atol=1e-9)


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """The demo's phantom in large tets, as a file."""
    out = tmp_path_factory.mktemp("demo")
    subprocess.run(
        [PROGRAMS / "viscera", "run", "configs/demo.yaml", "--until", "tetmesh", "--quiet",
         "--set", "tetmesh.cell_size=14mm", "--out", out],
        check=True,
    )
    return out / "demo" / "tetmesh" / "mesh.vtu"


@pytest.mark.parametrize("solver, substeps, frames", [("xpbd", 64, 12), ("fem", 1, 2)])
def test_a_run_gives_the_bits_of_the_program(demo, tmp_path, solver, substeps, frames):
    scene, end = "configs/scenes/drop.yaml", f"{frames / 60:.6f}s"
    subprocess.run(
        [PROGRAMS / "viscera-simulate", "--in", f"mesh={demo}", "--in", f"scene={scene}",
         "--set", f"solver={solver}", "--set", f"substeps={substeps}", "--set", f"end={end}", "--set", "threads=1",
         "--set", "forces=true", "--out", tmp_path / "run"],
        check=False,  # its gates fail: it has not come to rest
        capture_output=True,
    )
    with open(tmp_path / "run" / "metrics.csv", encoding="utf-8") as file:
        program = list(csv.DictReader(file))
    assert len(program) == frames + 1

    mesh = viscera.read_mesh(demo)
    params = {"solver": solver, "substeps": substeps, "end": end, "threads": 1,
              "forces": True}
    result = viscera.Simulation(mesh, scene, **params).run()
    rows = result["frames"]
    assert [row["state_hash"] for row in rows] == [row["state_hash"] for row in program]
    assert set(program[0]) - set(rows[1]) == {"force_handed_on_N"}
    assert rows[2]["total_J"] == pytest.approx(float(program[2]["total_J"]), rel=1e-8)
    assert rows[1]["force_gravity_z_N"] == pytest.approx(
        float(program[1]["force_gravity_z_N"]), rel=1e-5)

    stepped = viscera.Simulation(mesh, scene, **params)
    stepped.step(frames)
    assert stepped.state_hash == program[-1]["state_hash"]


def test_a_run_goes_on_from_where_it_was_stepped_to(mesh):
    scene = falling(fixed={"side": "superior"})
    scene["schedule"] = [{"at": "0.1 s", "effects": {"gravity": {"acceleration": "4 m/s2"}}},
                         {"at": "0.4 s", "materials": {"liver": {"E": "20 kPa"}}}]
    whole = viscera.Simulation(mesh, scene)
    whole.step(30)
    unchanged = viscera.Simulation(mesh, falling(fixed={"side": "superior"}))
    unchanged.step(30)
    assert whole.state_hash != unchanged.state_hash
    for first in (0, 10, 27):
        sim = viscera.Simulation(mesh, scene)
        sim.step(first)
        seen = []
        result = sim.run(progress=lambda frame, time_s, speed: seen.append(frame))
        assert seen == list(range(first, 31))
        assert result["frames"][-1]["frame"] == sim.frame == 30
        assert not result["rested"]
        assert sim.state_hash == whole.state_hash
        sim.step()
        assert sim.frame == 31


def test_a_body_at_rest_ends_the_run(mesh):
    scene = falling(ground={"clearance": "1 mm"})
    scene["time"]["end"] = "8 s"
    result = viscera.Simulation(mesh, scene, forces=True).run()
    assert result["rested"]
    last = result["frames"][-1]
    weight = 1060 * 0.05**3 * 9.80665
    assert last["force_ground_z_N"] == pytest.approx(weight, rel=1e-3)


def test_views_are_not_copied_not_written_to_and_outlive_the_step(mesh):
    sim = viscera.Simulation(mesh, falling())
    sim.step()
    before = sim.displacements
    assert np.shares_memory(before, sim.displacements)
    assert not before.flags.writeable and not before.flags.owndata
    kept = before.copy()
    sim.step(5)
    del sim
    np.testing.assert_array_equal(before, kept)
    points = mesh.points
    assert not points.flags.owndata and not points.flags.writeable


def test_other_threads_run_while_a_simulation_steps(mesh):
    points, tets = cube(8)
    sim = viscera.Simulation(viscera.TetMesh(points, tets, names={1: "liver"}), falling(), threads=1)
    refused, done = [], threading.Event()

    def look():
        while not done.is_set():
            try:
                sim.diagnose()
            except RuntimeError as error:
                refused.append(str(error))
            time.sleep(1e-3)

    other = threading.Thread(target=look)
    other.start()
    sim.step(30)
    done.set()
    other.join()
    assert "another thread is stepping this simulation" in refused


def test_ctrl_c_ends_a_long_call_between_two_frames(mesh):
    sim = viscera.Simulation(mesh, falling())
    threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        sim.step(1_000_000)
    frame = sim.frame
    assert 0 < frame < 1_000_000
    sim.step()
    assert sim.frame == frame + 1


def test_a_run_that_is_broken_off_goes_on_from_its_last_frame(mesh):
    whole = viscera.Simulation(mesh, falling())
    whole.step(20)
    sim = viscera.Simulation(mesh, falling())

    def breaks_off(frame, time_s, speed):
        if frame == 12:
            raise LookupError("enough")

    with pytest.raises(LookupError, match="enough"):
        sim.run(progress=breaks_off)
    assert sim.frame == 12
    sim.step(8)
    assert sim.state_hash == whole.state_hash


def test_simulations_that_are_gone_leave_no_memory(mesh):
    def resident_kb():
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    def one():
        sim = viscera.Simulation(mesh, falling(), threads=1)
        sim.step()
        return sim.displacements

    for _ in range(20):
        one()
    before = resident_kb()
    for _ in range(200):
        one()
    assert resident_kb() - before < 8 * 1024
