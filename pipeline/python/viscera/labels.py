"""From segmented voxels to a mesh, in memory."""

import os

from ._preparation import Labels, Surface
from ._preparation import labels_of as _labels_of
from ._preparation import read_labels as _read_labels

__all__ = ["Labels", "Surface", "read_labels"]

AXES = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def read_labels(source, spacing=None, origin=None, direction=None, names=None, **params):
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
        import SimpleITK

        spacing, origin, direction = source.GetSpacing(), source.GetOrigin(), source.GetDirection()
        source = SimpleITK.GetArrayViewFromImage(source)
    if spacing is None:
        raise ValueError("spacing: not given, allowed: mm along x, y and z")
    return _labels_of(source, spacing, origin or (0.0, 0.0, 0.0), direction or AXES, names or {}, params)
