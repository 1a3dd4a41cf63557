"""Scenes as plain data in memory, which every renderer takes: asset, looks, lights, camera, film and sampling."""

from lookdev.scene.camera import Camera, Lens, Pose, camera_rays
from lookdev.scene.framing import frame_camera, frame_fill
from lookdev.scene.scene import Film, Sampling, Scene

__all__ = ["Camera", "Film", "Lens", "Pose", "Sampling", "Scene", "camera_rays", "frame_camera", "frame_fill"]
