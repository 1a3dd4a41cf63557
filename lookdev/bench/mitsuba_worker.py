"""A render worker for Mitsuba 3's own principled BSDF: ``python -m lookdev.bench.mitsuba_worker``.

The benchmark starts this worker for the backend `mitsuba-principled`. The worker has the same protocol as the worker in
`lookdev.cycles`: frame tasks on standard input, answers on standard output. A task contains a `PrincipledSource`, with
values for the sockets of Blender's Principled BSDF. The worker translates these values to Mitsuba's ``principled``. The
models differ, so the pictures of the two renderers are only similar. `samples`, `seed` and `bounces` mean the same as
for Cycles. The variant of Mitsuba compiles kernels with LLVM.
"""

from __future__ import annotations

import importlib
import math
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from lookdev.arrays import Floats32
from lookdev.asset import Asset, read_asset
from lookdev.asset.triangles import triangulate
from lookdev.codegen.source import PrincipledSource
from lookdev.errors import LookdevError, RenderError
from lookdev.light import native_images
from lookdev.processes import end_with_parent
from lookdev.rendering import wire
from lookdev.rendering.answers import AnswerStream
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.frame import RenderedFrame
from lookdev.rendering.llvm import LLVM_VARIABLE, find_llvm
from lookdev.rendering.oidn import make_denoiser
from lookdev.rendering.task import FrameTask

VARIANT = "llvm_ad_rgb"

_TRIAL_TIMEOUT = 300.0  # seconds
_FEATURE_SAMPLES = 16  # samples of the albedo and normal that guide the denoiser: as many as the worker of Cycles takes

# Mitsuba's environment map has a local frame with y up. Its axes x, y, z are the axes y, z, x of the world.
_Y_UP_TO_Z_UP = [[0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]]

_TRIAL_SCENE = {
    "type": "scene",
    "integrator": {"type": "path"},
    "sensor": {"type": "perspective", "film": {"type": "hdrfilm", "width": 4, "height": 4}},
}


def main() -> None:
    """Render tasks from standard input until it ends; consecutive tasks with the same scene share it."""
    answers = AnswerStream()
    mi = load_mitsuba()
    answers.send_ready(f"mitsuba {mi.__version__} {VARIANT}")
    current: tuple[FrameTask, Any] | None = None
    for line in sys.stdin:
        task = wire.decode_frame_task(line)
        try:
            if current is None or not _is_same_scene(current[0], task):
                current = task, build_scene(mi, task)
            _render_frame(mi, current[1], task, answers)
        except (LookdevError, RuntimeError, OSError, MemoryError) as error:
            current = None
            answers.send_failure(task.digest, error)


def load_mitsuba() -> Any:
    """Import Mitsuba and set its variant; raises RenderError if Mitsuba, or an LLVM for it, is not installed."""
    os.environ[LLVM_VARIABLE] = find_llvm()
    mi: Any = importlib.import_module("mitsuba")
    mi.set_variant(VARIANT)
    return mi


def check_mitsuba() -> None:
    """Raise RenderError if Mitsuba cannot render on this machine.

    A child process renders a trial, because some versions of LLVM crash the process.
    """
    llvm = find_llvm()
    command = (sys.executable, "-m", "lookdev.bench.mitsuba_worker", "--try")
    environment = os.environ | {LLVM_VARIABLE: llvm}
    try:
        trial = subprocess.run(command, check=False, capture_output=True, env=environment, timeout=_TRIAL_TIMEOUT)
    except subprocess.TimeoutExpired:
        raise RenderError(f"Mitsuba does not render 4 x 4 pixels in {_TRIAL_TIMEOUT:g} s with {llvm}") from None
    if trial.returncode:
        last = (trial.stderr.decode(errors="replace").strip().splitlines() or ["no message"])[-1]
        raise RenderError(f"Mitsuba does not render with {llvm}; set {LLVM_VARIABLE} to another LLVM: {last[:200]}")


def principled_bsdf(inputs: Mapping[str, float | tuple[float, ...]]) -> dict[str, Any]:
    """Return Mitsuba's ``principled`` for values by the names of Blender's sockets.

    Raises RenderError for a socket without a counterpart.
    """
    bsdf: dict[str, Any] = {"type": "principled"}
    for name, value in inputs.items():
        match name, value:
            case "Base Color", tuple():
                bsdf["base_color"] = {"type": "rgb", "value": list(value)}
            case "Coat Roughness", float():
                # The alpha of the coat's microfacets is roughness squared in Blender. In Mitsuba, alpha is
                # 0.1 - 0.099 gloss (Burley 2012, 5.5).
                bsdf["clearcoat_gloss"] = min(1.0, max(0.0, (0.1 - value**2) / 0.099))
            case "Coat Weight", float():
                # Mitsuba's clearcoat has a quarter of the strength of Blender's coat, as in Burley's model.
                bsdf["clearcoat"] = min(1.0, 4.0 * value)
            case (("Metallic" | "Roughness" | "Anisotropic"), float()):
                bsdf[name.lower()] = value
            case _:
                raise RenderError(f"Mitsuba's principled has no counterpart of '{name}' = {value!r}")
    return bsdf


def build_scene(mi: Any, task: FrameTask) -> Any:
    """Build Mitsuba's scene of a task, with the centre of the asset at the origin.

    The asset does not turn: the camera and the light turn the other way.
    """
    scene, pose = task.scene, task.pose
    source, camera = scene.shaders[0], scene.camera.orbit(-pose.element)
    if not isinstance(source, PrincipledSource):
        raise RenderError("Mitsuba renders principled scenes only")
    if gaps := BACKENDS["mitsuba-principled"].light_gaps(scene.lights):
        raise RenderError(gaps[0])
    if camera.lens is not None or any(camera.shift):
        raise RenderError("the bench renders with Mitsuba through pinholes without lens shift only")
    asset, transform = read_asset(scene.asset.path), mi.ScalarTransform4f
    (image,) = native_images(scene.lights)
    # The file has further channels; the conversion leaves the radiance only.
    radiance = mi.Bitmap(str(image.path)).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    turn = transform().rotate([0, 0, 1], pose.lighting - pose.element)
    right, up, back = camera.frame
    # Mitsuba's camera looks along its z, with x to the left.
    to_world = np.eye(4)
    to_world[:3] = np.stack([-right, up, -back, camera.position - asset.center], axis=1)
    width, height = scene.resolution
    # Depth 1 is light seen directly, 2 is light reflected once. Russian roulette would begin at depth 1000: never.
    depths = {"max_depth": scene.sampling.bounces + 2, "rr_depth": 1000}
    film = {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgba", "rfilter": {"type": "box"}}
    bsdf = mi.load_dict(principled_bsdf(source.inputs))
    meshes = {f"mesh{number}": _make_mesh(mi, bsdf, *mesh) for number, mesh in enumerate(corner_meshes(asset))}
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "hide_emitters": True} | depths,
            "light": {"type": "envmap", "bitmap": radiance, "to_world": turn @ transform(_Y_UP_TO_Z_UP)},
            "sensor": {
                "type": "perspective",
                "fov": camera.fov,
                "fov_axis": "x",
                "near_clip": camera.clip[0],
                "far_clip": camera.clip[1],
                "to_world": transform(to_world.tolist()),
                "film": film,
                "sampler": {"type": "independent"},
            },
            **meshes,
        }
    )


def corner_meshes(asset: Asset) -> Iterator[tuple[Floats32, Floats32, Floats32]]:
    """Yield the positions (3 t, 3), normals (3 t, 3) and UVs (3 t, 2) of the corners of each instance's t triangles.

    Positions are relative to the centre of the asset. UVs are the first UV set of the mesh. If the mesh has none, they
    are 0: this backend renders looks of constants only, which do not read UVs.
    """
    triangles = [triangulate(mesh) for mesh in asset.meshes]
    for instance in asset.instances:
        mesh, matrix = triangles[instance.mesh], instance.matrix[:3, :3]
        positions = mesh.points[mesh.corner_points] @ matrix.T + instance.matrix[:3, 3] - asset.center
        normals = mesh.normals @ np.linalg.inv(matrix)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        uvs = next(iter(mesh.uvs.values()), np.zeros((len(positions), 2)))
        yield positions.astype(np.float32), normals.astype(np.float32), uvs.astype(np.float32)


def _make_mesh(mi: Any, bsdf: Any, positions: Floats32, normals: Floats32, uvs: Floats32) -> Any:
    """Return Mitsuba's mesh of the corners that `corner_meshes` yields; triangles share no vertices."""
    properties = mi.Properties()
    properties["bsdf"] = bsdf
    counts = len(positions), len(positions) // 3
    mesh = mi.Mesh("mesh", *counts, properties, has_vertex_normals=True, has_vertex_texcoords=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = positions.ravel()
    parameters["vertex_normals"] = normals.ravel()
    parameters["vertex_texcoords"] = uvs.ravel()
    parameters["faces"] = np.arange(len(positions), dtype=np.uint32)
    parameters.update()
    return mesh


def _render_frame(mi: Any, scene: Any, task: FrameTask, answers: AnswerStream) -> None:
    """Render a frame once, denoise it if the task requests that, and send it; both halves are the same picture."""
    sampling = task.scene.sampling
    start = time.perf_counter()
    # Mitsuba renders asynchronously. The copy waits for the pixels, so the time includes the whole render.
    pixels = np.array(mi.render(scene, spp=sampling.samples, seed=sampling.seed), dtype=np.float32)
    image, alpha = pixels[..., :3], pixels[..., 3]
    seconds = time.perf_counter() - start
    frame = RenderedFrame(image, image, alpha, sampling.samples, seconds, math.nan)
    if sampling.denoise != "off":
        # Albedo and shading normal of each pixel guide the denoiser.
        aovs = mi.load_dict({"type": "aov", "aovs": "albedo:albedo,normal:sh_normal"})
        features = np.array(mi.render(scene, integrator=aovs, spp=_FEATURE_SAMPLES, seed=sampling.seed), np.float32)
        smooth = make_denoiser(np.clip(features[..., -6:-3], 0.0, 1.0), features[..., -3:])(image)
        total_seconds = time.perf_counter() - start
        frame = RenderedFrame(
            smooth, smooth, alpha, sampling.samples, total_seconds, math.nan, image, math.nan, seconds
        )
    answers.send_frame(task.digest, frame)


def _is_same_scene(task: FrameTask, other: FrameTask) -> bool:
    """Return whether two tasks have the same pose, and the same scene except for samples, seed and denoising."""
    scene = replace(task.scene, sampling=replace(other.scene.sampling, bounces=task.scene.sampling.bounces))
    return (scene, task.pose) == (other.scene, other.pose)


if __name__ == "__main__":
    end_with_parent()
    if sys.argv[1:2] == ["--try"]:
        mitsuba = load_mitsuba()
        np.asarray(mitsuba.render(mitsuba.load_dict(_TRIAL_SCENE), spp=1))
    else:
        main()
