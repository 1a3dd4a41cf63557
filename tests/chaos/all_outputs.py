"""A batch of two looks that makes all there is of its frames, by the fake worker: a program, so that tests kill it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "batch"))

import batch_case as case

from lookdev.lifetime import ending_at_signals

TIN = '[[look]]\nname = "tin"\nmaterial = "gold.usda"\n'
WANTED = 'movie = true\nprores = true\nvp9 = true\ngrid = true\nburn_in = ["png", "movie"]\n'

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with ending_at_signals():
        result = case.run(folder, case.make_job(folder, case.TURNTABLES + TIN, case.RENDER + WANTED))
    os._exit(result.exit_code)
