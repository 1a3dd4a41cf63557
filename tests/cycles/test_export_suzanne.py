import subprocess
import sys
from importlib import resources

import numpy as np
import pytest


@pytest.mark.cycles
def test_the_shipped_suzanne_is_what_the_script_makes(tmp_path):
    out = tmp_path / "suzanne.npz"
    subprocess.run([sys.executable, "-m", "lookdev.cycles.export_suzanne", out], check=True, capture_output=True)
    shipped = resources.files("lookdev.asset").joinpath("data", "suzanne.npz")
    with np.load(out) as exported, shipped.open("rb") as stream, np.load(stream) as expected:
        assert set(exported.files) == set(expected.files) == {"points", "faces", "uvs"}
        np.testing.assert_array_equal(exported["faces"], expected["faces"])
        # Blender's subdivision runs in float32: a few roundings of coordinates around 1.
        np.testing.assert_allclose(exported["points"], expected["points"], atol=1e-6)
        np.testing.assert_allclose(exported["uvs"], expected["uvs"], atol=1e-6)
