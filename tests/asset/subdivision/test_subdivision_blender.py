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

NAMES = ("cube", "sharp ring", "soft ring", "junctions", "open", "open, edgeOnly", "any faces")
LEVEL = 3


@pytest.mark.cycles
@pytest.mark.both_pythons
def test_limits_are_those_of_blenders_modifier(tmp_path):
    files = {name: tmp_path / f"{number}.npz" for number, name in enumerate(NAMES)}
    for name, file in files.items():
        cage, rules = CAGES[name], CAGES[name].subdivision
        boundary = "ALL" if rules.interpolate_boundary == "edgeOnly" else "PRESERVE_CORNERS"
        edges = {"edges": rules.crease_edges, "edge_sharpness": rules.crease_sharpness}
        points = {"sharp_points": rules.corner_points, "point_sharpness": rules.corner_sharpness}
        faces = {"points": cage.points, "corners": cage.corner_points, "sizes": cage.face_sizes}
        np.savez(file, **faces, **edges, **points, level=LEVEL, boundary=boundary)
    program = Path(__file__).with_name("blender_modifier.py")
    subprocess.run([sys.executable, program, *files.values()], check=True, capture_output=True)
    for name, file in files.items():
        blender, ours = np.load(f"{file}.npy"), refine(CAGES[name], LEVEL).points
        assert len(blender) == len(ours), name
        # Blender evaluates patches in float32: a few roundings of coordinates below 2.
        assert KDTree(blender).query(ours)[0].max() < 16.0 * np.finfo(np.float32).eps, name
