"""Plans: the frames of a job, and the state of their files on disk, which determines what is rendered.

A *setup* is a look under a light. A frame is a setup in a pose, and has a digest of everything that affects its pixels.
"""

from lookdev.plan.plan import Charts, Plan, PlannedFile, Reel, build_plan
from lookdev.plan.poses import turntable_poses
from lookdev.plan.setup import Setup, TurntableFrames, make_setup

__all__ = ["Charts", "Plan", "PlannedFile", "Reel", "Setup", "TurntableFrames"]
__all__ += ["build_plan", "make_setup", "turntable_poses"]
