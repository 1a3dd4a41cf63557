"""A batch of two looks that makes all there is of its frames, by the fake worker: a program, so that tests kill it.

Frames have all passes, and the looks are those of a wedge, too.
"""

import os
import sys
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import batch_case as case

from lookdev.build.wedges import WedgeSheet
from lookdev.processes import end_at_signals
from lookdev.rendering.passes import PASSES
from lookdev.run.render import run_plan

TIN = '[[look]]\nname = "tin"\nmaterial = "gold.usda"\n'
PASSES_WANTED = case.RENDER.replace("samples = 8", f"samples = 8\npasses = {[*PASSES]}")
CELLS = (("gold", "city"), ("tin", "city"))
SHEET = WedgeSheet("metals", "gold to tin", "gold", "city", CELLS, ("gold", "tin"), None)
WANTED = 'movie = true\nprores = true\nvp9 = true\ngrid = true\nburn_in = ["png", "movie"]\n'

if __name__ == "__main__":
    folder = Path(sys.argv[1])
    with end_at_signals():
        job = case.make_job(folder, case.TURNTABLES + TIN, PASSES_WANTED + WANTED)
        plan = replace(case.make_plan(job), sheets=(SHEET,))
        result = run_plan(plan, job.outputs, job.render.background, worker_command=case.command(folder))
    os._exit(result.exit_code)
