"""What settings cost and how far off they are, on a mesh in memory."""

import numpy as np
import pytest
import viscera
from conftest import cube, falling


@pytest.fixture
def held():
    scene = falling(fixed={"side": "superior", "within": "5 mm"})
    scene["time"]["end"] = "6 s"
    scene["stability"] = "warn"
    return scene


def test_at_rest_settings_are_held_against_quadratic_tets(held):
    mesh = viscera.TetMesh(*cube(6), names={1: "liver"})
    settings = [{"element": "linear"}, {"element": "smoothed"}, {"solver": "fem", "fem_time": "quasi_static", "fem_order": 2}]
    heard = []
    rows = viscera.study(mesh, held, settings, progress=lambda done, of: heard.append((done, of)))
    assert heard == [(0, 4), (1, 4), (2, 4), (3, 4)]
    assert [row.get("element") for row in rows] == ["linear", "smoothed", None]
    linear, smoothed, quadratic = rows
    assert linear["error"] > 2 * smoothed["error"] > 0.0, "linear tets bend too little"
    assert quadratic["error"] < 1e-6
    for row in rows:
        assert row["rested"] is True and row["failed"] is None
        assert row["frame_ms"] == pytest.approx(1e3 * row["wall_s"] / row["frames"])
        assert row["largest_mm"] >= row["error_mm"]
    # By hand.
    sim, true = (viscera.Simulation(mesh, held, **params) for params in (settings[0], settings[2]))
    sim.run(), true.run()
    off = sim.displacements - true.displacements
    assert linear["error_mm"] == pytest.approx(1e3 * np.sqrt((off**2).sum() / len(off)), rel=1e-9)
    assert linear["error"] == pytest.approx(np.sqrt((off**2).sum() / (true.displacements**2).sum()), rel=1e-9)


def test_in_motion_more_substeps_are_nearer_to_many(mesh, held):
    rows = viscera.study(mesh, held, [{"substeps": n} for n in (16, 32, 64)], frames=6)
    errors = [row["error"] for row in rows]
    assert errors[0] > 2.0 * errors[1] > 3.5 * errors[2] > 0.0
    assert [row["frames"] for row in rows] == [6, 6, 6]
    assert [row["rested"] for row in rows] == [None] * 3
    of_one = viscera.study(mesh, held, [{"substeps": 16}], frames=6, truth={"substeps": 64})
    assert 0.0 < of_one[0]["error"] < errors[0] + errors[2]
    nearest = viscera.study(mesh, held, [{"substeps": 16}], frames=6, truth={"substeps": 16})
    assert nearest[0]["error"] == 0.0


@pytest.mark.parametrize("frames", [20, None])
def test_a_setting_that_diverges_says_so_and_the_others_go_on(mesh, held, frames):
    diverges, holds = viscera.study(mesh, held, [{"solver": "tled", "substeps": 1}, {}], frames=frames, truth={})
    assert "energy that rose" in diverges["failed"]
    assert {diverges[name] for name in ("error", "error_mm", "wall_s", "rested")} == {None}
    assert holds["failed"] is None and holds["error"] == 0.0


def test_what_cannot_be_meant_is_refused(mesh, held):
    with pytest.raises(viscera.Error) as refused:
        viscera.study(mesh, held, [{"substeps": -3}])
    assert refused.value.field == "substeps"
    for settings, frames in (([], None), ([{}], 0)):
        with pytest.raises(ValueError, match="allowed"):
            viscera.study(mesh, held, settings, frames=frames)
