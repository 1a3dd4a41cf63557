"""Plans: the frames to render, each with a pose of a setup and a digest of everything that affects its pixels."""

from lookdev.plan.plan import Charts, Plan, PlannedFile, Reel, build_plan
from lookdev.plan.poses import turntable_poses
from lookdev.plan.setup import Setup, TurntableFrames, make_setup

__all__ = ["Charts", "Plan", "PlannedFile", "Reel", "Setup", "TurntableFrames"]
__all__ += ["build_plan", "make_setup", "turntable_poses"]
