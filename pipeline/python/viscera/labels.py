"""From segmented voxels to a mesh, in memory."""

import importlib
import os
from collections.abc import Mapping, Sequence
from typing import Any

from numpy.typing import ArrayLike

from . import bridges, pictures
from ._preparation import Labels, Surface
from ._preparation import labels_of as _labels_of
from ._preparation import read_labels as _read_labels

__all__ = ["Labels", "Surface", "read_labels"]

# What a notebook shows of them.
setattr(Labels, "_repr_html_", pictures.of_labels)
setattr(Surface, "_repr_html_", pictures.of_surface)
setattr(Surface, "to_vtk", bridges.surface_to_vtk)

AXES = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def read_labels(
    source: Any,
    spacing: Sequence[float] | None = None,
    origin: Sequence[float] | None = None,
    direction: Sequence[float] | None = None,
    names: Mapping[int, str] | None = None,
    **params: Any,
) -> Labels:
    """Segmented voxels, cleaned as viscera-labels does: one body with a margin of background.

    source: what viscera-labels reads (a path, or a list of them: NIfTI, NRRD, MetaImage, DICOM), an
    image of SimpleITK, or an array of ids as SimpleITK.GetArrayFromImage gives it: [k, j, i], the
    last axis along x.

    Of an array: spacing, mm along x, y and z, must be given; origin, LPS mm of the centre of
    voxel [0, 0, 0]; direction, nine numbers row by row, column a being axis a in LPS; names, the
    materials by id. params are those of viscera-labels by name, as in labels={"liver": [1, 2]},
    keep="each" or border="accept". Raises viscera.Error, and TypeError or ValueError for what is no
    such array.
    """
    if isinstance(source, (str, os.PathLike)):
        source = [source]
    if isinstance(source, (list, tuple)) and all(isinstance(s, (str, os.PathLike)) for s in source):
        if not source:
            raise ValueError("source: no files")
        if any(value is not None for value in (spacing, origin, direction, names)):
            raise ValueError("spacing, origin, direction and names are those of the file")
        return _read_labels([os.fspath(s) for s in source], params)
    if hasattr(source, "GetDirection"):
        if any(value is not None for value in (spacing, origin, direction)):
            raise ValueError("spacing, origin and direction are those of the image")
        spacing, origin, direction = source.GetSpacing(), source.GetOrigin(), source.GetDirection()
        source = importlib.import_module("SimpleITK").GetArrayViewFromImage(source)
    if spacing is None:
        raise ValueError("spacing: not given, allowed: mm along x, y and z")
    origin = (0.0, 0.0, 0.0) if origin is None else origin
    return _labels_of(source, spacing, origin, AXES if direction is None else direction, names or {}, params)
