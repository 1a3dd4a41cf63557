"""What to render: the poses of setups as frame tasks, each with a digest of all that affects it."""

from lookdev.plan.plan import Charts, Copy, Plan, PlannedFile, Reel, build_plan
from lookdev.plan.poses import turntable_poses
from lookdev.plan.setup import Setup, Turns, make_setup

__all__ = [
    "Charts",
    "Copy",
    "Plan",
    "PlannedFile",
    "Reel",
    "Setup",
    "Turns",
    "build_plan",
    "make_setup",
    "turntable_poses",
]
