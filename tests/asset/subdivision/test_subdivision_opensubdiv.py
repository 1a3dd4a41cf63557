"""OpenSubdiv's limits of small cages: every scheme, rule and kind of tag; and those of Blender's modifier.

The numbers are what OpenSubdiv 3.6.0 computes for these cages after six uniform refinements, in double precision
(Far::PrimvarRefinerReal): the limit of each point, which points are shown, and the limit of each corner's UVs.
Blender's subdivision modifier, which is OpenSubdiv in another version, is a second witness.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cages import CAGES, cage_corners
from scipy.spatial import KDTree

from lookdev.asset.subdivision import refine

ORACLE = json.loads((Path(__file__).parents[2] / "oracles" / "opensubdiv.json").read_text())["cages"]

# Positions and UVs below 4, stored in float32.
TOLERANCE = 4.0 * np.finfo(np.float32).eps


@pytest.mark.parametrize("level", [1, 2, 3])
@pytest.mark.parametrize("name", CAGES)
def test_limits_are_those_of_opensubdiv_at_any_level(name, level):
    cage, oracle = CAGES[name], ORACLE[name]
    corners, children = cage_corners(cage, refine, level)
    refined = refine(cage, level)
    points = cage.corner_points[corners]
    assert set(points) == set(oracle["shown"])
    limits = refined.points[refined.corner_points[children]]
    np.testing.assert_allclose(limits, np.array(oracle["limits"])[points], atol=TOLERANCE, rtol=0.0)
    if cage.uvs:
        np.testing.assert_allclose(refined.uvs["st"][children], oracle["uvs"], atol=TOLERANCE, rtol=0.0)


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
