from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._viscera import TetMesh

class Labels:
    """Segmented voxels, cleaned: voxels [k, j, i] are ids, the last axis along the first column of
    direction (nine numbers, row by row); spacing (x, y, z) and origin, of the centre of voxel [0, 0, 0],
    are in LPS mm. surface and tet_mesh take the params of viscera-surface and viscera-tetmesh by name, as
    in cell_size="5 mm"; the mesh's distance from a surface is measured."""

    @property
    def voxels(self) -> NDArray[np.uint16]: ...
    @property
    def spacing(self) -> list[float]: ...
    @property
    def origin(self) -> list[float]: ...
    @property
    def direction(self) -> list[float]: ...
    @property
    def names(self) -> dict[int, str]: ...
    @property
    def gates(self) -> list[dict[str, Any]]: ...
    @property
    def metrics(self) -> dict[str, Any]: ...
    @property
    def caveats(self) -> list[str]: ...
    def surface(self, **params: Any) -> Surface: ...
    def tet_mesh(self, surface: Surface | None = None, size_field: TetMesh | None = None,
                 **params: Any) -> TetMesh: ...

class Surface:
    """Closed triangle surfaces, one a material and one of the whole body (0), seen from outside: points
    [n, 3] LPS mm, triangles [m, 3], labels [m]. tet_mesh takes the params of viscera-tetmesh by name."""

    def __init__(
        self,
        points: ArrayLike,
        triangles: ArrayLike,
        labels: ArrayLike | None = None,
        names: Mapping[int, str] = ...,
    ) -> None: ...
    @property
    def points(self) -> NDArray[np.float64]: ...
    @property
    def triangles(self) -> NDArray[np.int32]: ...
    @property
    def labels(self) -> NDArray[np.int32]: ...
    @property
    def names(self) -> dict[int, str]: ...
    @property
    def gates(self) -> list[dict[str, Any]]: ...
    @property
    def metrics(self) -> dict[str, Any]: ...
    @property
    def caveats(self) -> list[str]: ...
    def tet_mesh(self, **params: Any) -> TetMesh: ...
    def to_vtk(self) -> Any: ...  # a vtkPolyData

def read_labels(sources: Sequence[str], params: Mapping[str, Any], /) -> Labels: ...
def labels_of(
    array: ArrayLike,
    spacing: Sequence[float],
    origin: Sequence[float],
    direction: Sequence[float],
    names: Mapping[int, str],
    params: Mapping[str, Any],
    /,
) -> Labels: ...
