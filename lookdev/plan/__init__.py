"""What to render: a job's poses as frame tasks, each with a digest of all that affects it."""

from lookdev.plan.plan import Copy, Plan, PlannedFile, PlannedFrame, build_plan, frame_files, frame_sampling
from lookdev.plan.poses import turntable_poses

__all__ = [
    "Copy",
    "Plan",
    "PlannedFile",
    "PlannedFrame",
    "build_plan",
    "frame_files",
    "frame_sampling",
    "turntable_poses",
]
