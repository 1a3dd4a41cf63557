"""OpenSubdiv's limits of small cages: every scheme, rule and kind of tag.

The numbers are what OpenSubdiv 3.6.0 computes for these cages after six uniform refinements, in double precision
(Far::PrimvarRefinerReal): the limit of each point, which points are shown, and the limit of each corner's UVs.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cages import CAGES, own_corners

from lookdev.asset.subdivision import refine

ORACLE = json.loads((Path(__file__).parents[2] / "oracles" / "opensubdiv.json").read_text())["cages"]

# Positions and UVs below 4, stored in float32.
TOLERANCE = 4.0 * np.finfo(np.float32).eps


@pytest.mark.parametrize("level", [1, 2, 3])
@pytest.mark.parametrize("name", CAGES)
def test_limits_are_those_of_opensubdiv_at_any_level(name, level):
    cage, oracle = CAGES[name], ORACLE[name]
    corners, children = own_corners(cage, refine, level)
    refined = refine(cage, level)
    points = cage.corner_points[corners]
    assert set(points) == set(oracle["shown"])
    limits = refined.points[refined.corner_points[children]]
    np.testing.assert_allclose(limits, np.array(oracle["limits"])[points], atol=TOLERANCE, rtol=0.0)
    if cage.uvs:
        np.testing.assert_allclose(refined.uvs["st"][children], oracle["uvs"], atol=TOLERANCE, rtol=0.0)
