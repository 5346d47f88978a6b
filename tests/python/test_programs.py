"""Specs that the programs run, from Python."""

import pytest
import viscera
from conftest import PROGRAMS
from viscera import programs


@pytest.fixture(autouse=True)
def beside_the_tests(monkeypatch):
    monkeypatch.setenv("VISCERA_BIN", str(PROGRAMS.resolve()))


def test_a_spec_runs_once_and_its_stages_say_what_they_found(tmp_path):
    values = {"tetmesh.cell_size": "14 mm", "simulate.end": "0.1 s", "simulate.forces": True, "simulate.substeps": 48}
    heard = []
    stages = viscera.run("configs/demo.yaml", values, out=tmp_path, until="simulate",
                         progress=lambda share, what: heard.append((share, what)))
    assert list(stages) == ["labels", "surface", "tetmesh", "simulate"]
    assert heard[-1] == (1.0, "simulate: ran")
    simulate = stages["simulate"]
    assert simulate.metrics["substeps"] == 48
    rows = simulate.table("metrics.csv")
    assert [row["frame"] for row in rows] == list(range(7))
    assert isinstance(rows[0]["state_hash"], str)
    weights = [row["force_gravity_z_N"] for row in rows if row["force_gravity_z_N"] is not None]
    assert weights and max(weights) < 0.0
    assert not simulate.gates["rest_time"]["passed"], "a gate that fails raises nothing"
    assert not simulate.passed
    assert stages["tetmesh"].passed
    assert stages["tetmesh"].gates["min_dihedral"]["value"] > 10.0
    heard.clear()
    again = viscera.run("configs/demo.yaml", values, out=tmp_path, until="simulate",
                        progress=lambda share, what: heard.append((share, what)))
    assert "simulate: cached" in [what for _, what in heard]
    assert again["simulate"].metrics == simulate.metrics


def test_a_run_that_cannot_be_made_raises_what_the_programs_say(tmp_path):
    with pytest.raises(programs.Failed, match="cell_size") as failed:
        viscera.run("configs/demo.yaml", {"tetmesh.cell_size": "-1 mm"}, out=tmp_path, until="tetmesh")
    assert failed.value.exit_code == 3


def test_an_estimate_says_what_a_run_would_take_and_writes_nothing(tmp_path):
    values = {"tetmesh.cell_size": "14 mm"}
    said = viscera.estimate("configs/demo.yaml", values, out=tmp_path / "out")
    assert [stage["stage"] for stage in said["stages"]] == ["labels", "surface", "tetmesh", "simulate", "report"]
    low, high = said["wall_s"]
    assert 0.0 < low < high
    assert said["memory_mb"] > 50.0
    assert said["unknown"] == []
    assert any("% off" in words for words in said["stages"][3]["words"])
    assert not (tmp_path / "out").exists()
    with pytest.raises(programs.Failed, match="cell_size"):
        viscera.estimate("configs/demo.yaml", {"tetmesh.cell_size": "-1 mm"}, out=tmp_path / "out")


def test_measured_bodies_are_rows_beside_their_page(tmp_path, monkeypatch):
    program = tmp_path / "measured"
    program.write_text("""#!/bin/sh
[ "$2" = there ] || { echo "$2: no measurements" >&2; exit 4; }
mkdir -p "$1"
printf 'body,state,solver,error\\nTruth Cube,5%% strain,xpbd (default),0.328\\n' > "$1/measured.csv"
""")
    program.chmod(0o755)
    monkeypatch.setenv("VISCERA_BIN", str(tmp_path))
    rows = viscera.measured("there", out=tmp_path / "page")
    assert rows == [{"body": "Truth Cube", "state": "5% strain", "solver": "xpbd (default)", "error": 0.328}]
    with pytest.raises(programs.Failed, match="elsewhere: no measurements") as failed:
        viscera.measured("elsewhere", out=tmp_path / "page")
    assert failed.value.exit_code == 4
