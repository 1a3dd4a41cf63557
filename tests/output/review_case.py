"""Outputs of jobs for the review page: small frames with headers as a run writes them, and noise of known size."""

import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from lookdev.metrics import relmse_of_halves, standard_error
from lookdev.output.exr import write_frame

WIDTH, HEIGHT = 64, 48
TURNTABLES = {"element": 4, "lighting": 3}
NOISE = 0.05  # standard deviation of a half, relative


def picture(look: int, rig: int, turn: float, size: tuple[int, int] = (WIDTH, HEIGHT)) -> tuple[np.ndarray, np.ndarray]:
    """Return a ball under a light that orbits it, without noise: premultiplied (H, W, 3) and alpha (H, W)."""
    width, height = size
    y, x = np.mgrid[:height, :width]
    u, v = (x + 0.5 - width / 2) / (0.45 * height), (y + 0.5 - height / 2) / (0.45 * height)
    alpha = np.clip((1.0 - np.hypot(u, v)) * 0.45 * height + 0.5, 0.0, 1.0)
    normal = np.sqrt(np.maximum(1.0 - u * u - v * v, 0.0))
    light = np.maximum(u * np.sin(turn) + normal * np.cos(turn), 0.0) + 0.02
    tint = np.random.default_rng([look, rig]).uniform(0.05, 1.0, 3)
    return (light**2 * alpha)[..., None] * tint * 4.0, alpha


def write_job(
    folder: Path,
    looks: Sequence[str] = ("gold", "tin"),
    rigs: Sequence[str] = ("city", "studio"),
    turntables: Mapping[str, int] = TURNTABLES,
    *,
    seed: int = 0,
    gain: float = 1.0,
    size: tuple[int, int] = (WIDTH, HEIGHT),
    error: bool = True,
) -> Path:
    """Write all frames of a job, with the first look multiplied by `gain`, and return the folder."""
    rng = np.random.default_rng(seed)
    for number, look in enumerate(looks):
        for rig_number, rig in enumerate(rigs):
            for turntable, count in turntables.items():
                for frame in range(count):
                    degrees = 360.0 * frame / count
                    factor = 1.0 if number else gain
                    clean, alpha = picture(number, rig_number, np.radians(degrees), size)
                    noise = NOISE * rng.standard_normal((2, *clean.shape))
                    a, b = (factor * clean * (1.0 + noise)).astype(np.float32)
                    header = header_of(look, rig, turntable, degrees, seed, factor)
                    header["relmse"] = repr(relmse_of_halves(a, b, alpha.astype(np.float32)))
                    file = folder / look / rig / f"{turntable}.{frame + 1:04d}.exr"
                    write_frame(file, (a + b) / 2, alpha, header, {"error": standard_error(a, b)} if error else {})
    return folder


def header_of(look: str, rig: str, turntable: str, degrees: float, seed: int, gain: float) -> dict[str, str]:
    parts = {"look": f"{look} {gain}", "ibl": rig, "pose": f"{turntable} {degrees}", "render": str(seed)}
    digests = {f"digest.{name}": hashlib.sha256(text.encode()).hexdigest() for name, text in parts.items()}
    return {
        "job": "/jobs/ball.toml", "asset": "ball", "look": look, "ibl": rig, "turntable": turntable,
        "pose.element": "0.0", "pose.lighting": "0.0", f"pose.{turntable}": str(degrees),
        "exposure": "0.0", **digests, "digest": hashlib.sha256(repr(parts).encode()).hexdigest(),
        "samples": "64", "seconds": "1.5", "version.lookdev": "0.1.0", "time": "2026-01-01T00:00:00+00:00",
    }  # fmt: skip
