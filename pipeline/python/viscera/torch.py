"""Bodies at rest as functions of torch: displacements with gradients by what the scene says."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from . import Simulation
from ._viscera import TetMesh


class AtRest:
    """The displacements of a body at rest for numbers of its scene, by finite elements and Newton's method.

        at_rest = AtRest(mesh, scene, ["materials.liver.E"])
        E = torch.tensor(5e3, dtype=torch.float64, requires_grad=True)
        at_rest(E)[:, 2].mean().backward()

    names are those of Simulation.gradient, values scalars in SI units, in their order. Returns [n, 3] m, float64.
    One linear system gives the gradients by all of them (the adjoint method). What has no exact gradient is
    refused as there. params are those of viscera-simulate but the solver's own. What leads or loads the body over a
    time has come to its end; ValueError where it never does.
    """

    def __init__(self, mesh: TetMesh, scene: Mapping[str, Any] | str, names: Sequence[str], **params: Any) -> None:
        tolerance = params.pop("fem_tolerance", 1e-11)
        self.names = list(names)
        self._values: list[float] = []
        self._simulation = Simulation(
            mesh, scene, solver="fem", fem_time="quasi_static", fem_tolerance=tolerance, **params)

    def __call__(self, *values: torch.Tensor) -> torch.Tensor:
        if len(values) != len(self.names):
            raise ValueError(f"{len(values)} values, allowed: {len(self.names)}, one a name")
        found: torch.Tensor = _AtRest.apply(self, *values)
        return found

    def _find(self, values: Sequence[float]) -> Simulation:
        """The simulation in the equilibrium for these values."""
        if list(values) != self._values:
            self._values = []  # until it is found
            for name, value in zip(self.names, values):
                self._simulation.set(name, value)
            self._simulation.step()
            if self._simulation.time < self._simulation.loads_end:
                self._simulation.run(until=self._simulation.loads_end)
            self._values = list(values)
        return self._simulation


class _AtRest(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *args: Any, **kwargs: Any) -> torch.Tensor:
        at_rest, *values = args
        ctx.at_rest, ctx.values = at_rest, [float(value) for value in values]
        ctx.like = [(value.dtype, value.shape) for value in values]
        return torch.tensor(at_rest._find(ctx.values).displacements)

    @staticmethod
    def backward(ctx: Any, *grads: Any) -> tuple[torch.Tensor | None, ...]:
        by_displacement, = grads
        simulation = ctx.at_rest._find(ctx.values)
        slope = by_displacement.detach().to(torch.float64).numpy()
        gradient = simulation.gradient(slope, ctx.at_rest.names)
        return (None, *(torch.tensor(gradient[name], dtype=dtype).reshape(shape)
                        for name, (dtype, shape) in zip(ctx.at_rest.names, ctx.like)))
