"""Bodies at rest as functions of torch."""

import pytest
import torch
import viscera
from conftest import cube, falling
from viscera.torch import AtRest

NAMES = ["materials.liver.E", "effects.gravity.acceleration", "effects.prescribed.displacement.x"]


def made(names=NAMES):
    mesh = viscera.TetMesh(*cube(cells=2), names={1: "liver"})
    scene = falling(fixed={"side": "superior", "within": "1 mm"}, gravity={"acceleration": "9 m/s2"},
                    prescribed={"side": "inferior", "within": "1 mm", "displacement": ["0 mm", "0 mm", "-3 mm"],
                                "duration": "0 s"})
    scene["materials"]["liver"]["nu"] = 0.4
    return AtRest(mesh, scene, names)


def scalars(*values):
    return [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in values]


def test_gradients_are_those_of_differences():
    at_rest = made()
    weights = torch.randn(27, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(4))

    def quantity(kilopascal, gravity, aside):
        u = at_rest(1e3 * kilopascal, gravity, 1e-3 * aside)
        return (weights * u).sum() * 1e3 + 1e5 * (u**2).sum()

    assert torch.autograd.gradcheck(quantity, scalars(5.0, 9.8, 1.5), eps=1e-4, atol=1e-6, rtol=1e-5)


def test_a_body_that_is_led_over_a_time_is_where_it_is_led_to_however_often_it_is_asked():
    mesh = viscera.TetMesh(*cube(cells=2), names={1: "liver"})
    led = {"side": "inferior", "within": "1 mm", "displacement": ["0 mm", "0 mm", "-3 mm"], "duration": "0.1 s"}
    scene = falling(fixed={"side": "superior", "within": "1 mm"}, prescribed=led)
    at_rest = AtRest(mesh, scene, ["materials.liver.E"])
    low = mesh.points[:, 2] < mesh.points[:, 2].min() + 0.5
    for stiffness in (5e3, 6e3, 5e3):
        u = at_rest(torch.tensor(stiffness))
        assert u[torch.tensor(low), 2].numpy() == pytest.approx(-3e-3, abs=1e-9)


def test_a_stiffness_is_found_again_from_how_a_body_hangs():
    at_rest = made(["materials.liver.E"])
    seen = at_rest(torch.tensor(7e3)).detach()
    logarithm = torch.tensor(8.0, dtype=torch.float64, requires_grad=True)  # 3 kPa
    optimizer = torch.optim.LBFGS([logarithm], max_iter=30, tolerance_grad=1e-12, tolerance_change=1e-14,
                                  line_search_fn="strong_wolfe")

    def off():
        optimizer.zero_grad()
        loss = 1e6 * ((at_rest(logarithm.exp()) - seen) ** 2).sum()
        loss.backward()
        return loss

    optimizer.step(off)
    assert logarithm.exp().item() == pytest.approx(7e3, rel=1e-4)


def test_a_gradient_is_that_of_its_own_values_whatever_was_asked_since():
    at_rest = made(["materials.liver.E"])
    soft, stiff = scalars(4e3, 9e3)
    first, _ = at_rest(soft)[:, 2].sum(), at_rest(stiff)
    first.backward()
    alone, = scalars(4e3)
    made(["materials.liver.E"])(alone)[:, 2].sum().backward()
    assert soft.grad.item() == pytest.approx(alone.grad.item(), rel=1e-8)


def test_values_that_no_body_has_are_refused_and_leave_the_others_usable():
    at_rest = made(["materials.liver.E"])
    before = at_rest(torch.tensor(5e3)).detach()
    with pytest.raises(viscera.Error) as caught:
        at_rest(torch.tensor(-1.0))
    assert caught.value.field == "materials.liver.E"
    with pytest.raises(ValueError, match="one a name"):
        at_rest()
    assert torch.allclose(at_rest(torch.tensor(5e3)), before, rtol=0.0, atol=1e-10)
    with pytest.raises(viscera.Error):
        made(["materials.heart.E"])(torch.tensor(1.0))


def test_only_solvers_without_a_limit_of_stability_take_other_values():
    mesh = viscera.TetMesh(*cube(cells=2), names={1: "liver"})
    with pytest.raises(viscera.Error, match="substeps"):
        viscera.Simulation(mesh, falling(), solver="xpbd").set("materials.liver.E", 1e4)
