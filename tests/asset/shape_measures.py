"""Measures of a shape, from its points and faces alone."""

from __future__ import annotations

import numpy as np

from lookdev.asset.normals import area_vectors


def corners(shape):
    """Return the points at the corners, (m, 3)."""
    return shape.points[shape.face_points]


def face_areas(shape):
    """Return each face's area times its unit normal, (f, 3)."""
    return area_vectors(corners(shape), shape.face_sizes)


def area(shape):
    return np.linalg.norm(face_areas(shape), axis=1).sum()


def volume(shape):
    """Return the volume inside, positive where faces wind counter-clockwise seen from outside."""
    first = np.cumsum(shape.face_sizes) - shape.face_sizes
    return (face_areas(shape) * corners(shape)[first]).sum() / 3.0


def facets(shape):
    """Return the unit normal of each corner's face, (m, 3)."""
    areas = face_areas(shape)
    return np.repeat(areas / np.linalg.norm(areas, axis=1, keepdims=True), shape.face_sizes, axis=0)


def at_corners(shape, attribute):
    """Return the values of an attribute by point or corner, at the corners."""
    return attribute.values if attribute.interpolation == "faceVarying" else attribute.values[shape.face_points]


def corner_st(shape):
    (st,) = (each for each in shape.attributes if each.name == "st")
    assert st.is_uv
    return at_corners(shape, st)
