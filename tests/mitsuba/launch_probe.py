"""Renders the frame of a task by launches of some length, and writes its arrays: TASK SECONDS FILE."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from lookdev.mitsuba import render
from lookdev.mitsuba.load import load_mitsuba
from lookdev.render.wire import decode

if __name__ == "__main__":
    task = decode(Path(sys.argv[1]).read_text())
    render.LONGEST_LAUNCH = float(sys.argv[2])
    frame = render.MitsubaScene(load_mitsuba("cpu"), task.scene).render(task, lambda *progress: None)
    np.savez(sys.argv[3], a=frame.a, b=frame.b, alpha=frame.alpha, samples=frame.samples)
