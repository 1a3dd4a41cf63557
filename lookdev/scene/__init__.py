"""Scenes as plain data in memory: asset, looks, lights, camera, film and sampling."""

from lookdev.scene.camera import Camera, Lens, Pose
from lookdev.scene.framing import frame_camera, frame_fill
from lookdev.scene.rays import camera_rays
from lookdev.scene.sampling import SAMPLE_CAP, Sampling
from lookdev.scene.scene import Film, Scene

__all__ = [
    "SAMPLE_CAP",
    "Camera",
    "Film",
    "Lens",
    "Pose",
    "Sampling",
    "Scene",
    "camera_rays",
    "frame_camera",
    "frame_fill",
]
