"""Blender's subdivision modifier, which is OpenSubdiv in another version, as a second witness."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cages import CAGES
from scipy.spatial import KDTree

from lookdev.asset.subdivision import refine


@pytest.mark.cycles
@pytest.mark.parametrize(
    "name", ["cube", "sharp ring", "soft ring", "junctions", "open", "open, edgeOnly", "any faces"]
)
def test_limits_are_those_of_blenders_modifier(name, tmp_path):
    cage, level = CAGES[name], 3
    rules, file = cage.subdivision, tmp_path / "cage.npz"
    np.savez(
        file,
        points=cage.points,
        corners=cage.corner_points,
        sizes=cage.face_sizes,
        edges=rules.crease_edges,
        edge_sharpness=rules.crease_sharpness,
        sharp_points=rules.corner_points,
        point_sharpness=rules.corner_sharpness,
        level=level,
        boundary="ALL" if rules.interpolate_boundary == "edgeOnly" else "PRESERVE_CORNERS",
    )
    subprocess.run(
        [sys.executable, Path(__file__).with_name("blender_modifier.py"), file], check=True, capture_output=True
    )
    blender, ours = np.load(f"{file}.npy"), refine(cage, level).points
    assert len(blender) == len(ours)
    distance, _ = KDTree(blender).query(ours)
    # Blender evaluates patches in float32: a few roundings of coordinates below 2.
    assert distance.max() < 16.0 * np.finfo(np.float32).eps
