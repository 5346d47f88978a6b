"""Reports from memory, held against those of the programs, and what simulations say of themselves."""

import json
import subprocess

import pytest
import viscera
from conftest import PROGRAMS, ball, falling


def held(**more):
    """Hangs by its upper side until it rests."""
    scene = falling(fixed={"side": "superior", "within": "6 mm"}, **more)
    return {**scene, "time": {"frame_rate": "60 Hz", "substeps": 32, "end": "3 s"},
            "rest": {"speed": "2 mm/s", "hold": "50 ms"}, "expect": {"rest_time": {"max": 3}}}


def mesh_of_a_ball():
    return viscera.read_labels(ball(24, 9.0), (2.0, 2.0, 2.0), names={1: "liver"}).tet_mesh(cell_size="8 mm")


def test_a_report_is_that_of_the_programs(demo, tmp_path):
    scene, end = "configs/scenes/drop.yaml", "0.1 s"
    report = viscera.report(viscera.read_mesh(demo / "tetmesh/mesh.vtu"), scene, title="A fall", end=end)
    subprocess.run([PROGRAMS / "viscera-simulate", "--in", f"mesh={demo / 'tetmesh/mesh.vtu'}", "--in", f"scene={scene}",
                    "--set", f"end={end}", "--out", tmp_path / "simulate", "--quiet"],
                   check=False, capture_output=True)  # its gates fail: it has not come to rest
    subprocess.run([PROGRAMS / "viscera-report", "--in", f"trajectory={tmp_path / 'simulate/trajectory.h5'}",
                    "--set", "title=A fall", "--out", tmp_path / "report", "--quiet"], check=True, capture_output=True)
    programs = json.loads((tmp_path / "report/summary.json").read_text())
    assert report.summary["final"] == programs["final"] and "state_hash" in programs["final"]
    assert report.summary["verdict"] == programs["verdict"]
    assert "A fall" in report.html
    report.save(tmp_path / "page.html")
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == report.html
    assert "<iframe" in report._repr_html_() and "failed" in repr(report)


def test_a_report_begins_with_the_gates_of_the_mesh_and_a_simulation_has_its_own():
    mesh = mesh_of_a_ball()
    report = viscera.report(mesh, held())
    by_stage = {stage["stage"]: stage for stage in report.summary["stages"]}
    assert [gate["name"] for gate in by_stage["tetmesh"]["gates"]] == [gate["name"] for gate in mesh.gates]
    sim = viscera.Simulation(mesh, held())
    assert sim.gates == []  # nothing has been judged
    sim.run()
    assert sim.gates and [gate["value"] for gate in sim.gates if gate["name"] != "damping_acting"] == [
        gate["value"] for gate in by_stage["simulate"]["gates"] if gate["name"] != "damping_acting"]
    assert sim.metrics["rest_time"] == by_stage["simulate"]["metrics"]["rest_time"]["value"]
    assert "gates passed" in sim._repr_html_() or "gate passed" in sim._repr_html_()
    assert " mm off" not in sim._repr_html_()
    sim.certify()
    assert " mm off" in sim._repr_html_()
    sim.step()
    assert sim.gates == [] and " mm off" not in sim._repr_html_()


def test_a_report_that_cannot_be_made_says_why_and_leaves_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)
    mesh = mesh_of_a_ball()
    with pytest.raises(viscera.Error, match="gravitation"):
        viscera.report(mesh, held(gravitation={}))
    with pytest.raises(viscera.Error) as caught:
        viscera.report(mesh, held(), max_frames=1)
    assert caught.value.field == "max_frames"
    assert list(tmp_path.iterdir()) == []
