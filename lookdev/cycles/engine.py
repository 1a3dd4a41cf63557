"""Cycles with every setting set, and its pixels in memory."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from lookdev.cycles import version
from lookdev.errors import RenderError

sys.path.append(str(Path(bpy.utils.resource_path("LOCAL")) / "scripts" / "addons_core"))
import cycles

_ENGINE = "LOOKDEV_CYCLES"
SMALLEST = 4
"""Pixels along a side of the least picture that Blender renders."""

_LONGEST_TABLE = 8192  # samples for which Cycles tabulates points; more repeat them, shuffled

Box = tuple[int, int, int, int]
"""Left, bottom, right and top in pixels from the lower left corner of the frame."""


class Capture(cycles.CyclesRender):  # type: ignore[misc]
    """Cycles under another name, which keeps its passes in memory."""

    bl_idname = _ENGINE
    bl_label = "lookdev"

    passes: dict[str, NDArray[np.float32]] = {}  # noqa: RUF012  (of the last render; Blender makes the instances)

    def update_script_node(self, node: Any) -> None:
        """Do nothing: `lookdev.cycles.shaders` makes the sockets, for which Blender would parse the shader."""

    def render(self, depsgraph: Any) -> None:
        """Render, then copy every pass: (height, width, channels), rows bottom-up."""
        super().render(depsgraph)
        result = self.get_result()
        width, height = result.resolution_x, result.resolution_y
        for render_pass in result.layers[0].passes:
            pixels = np.empty(width * height * render_pass.channels, dtype=np.float32)
            render_pass.rect.foreach_get(pixels)
            Capture.passes[render_pass.name] = pixels.reshape(height, width, render_pass.channels)


bpy.utils.register_class(Capture)


def render_passes(scene: Any, samples: int, seed: int = 0, box: Box | None = None) -> dict[str, NDArray[np.float32]]:
    """Render the scene with `samples` a pixel and return its passes by Blender's names, rows bottom-up.

    Cycles places sample 0 of every pixel at its centre, which would bias coverage by up to half a sample. The second
    block of the sequence has no such sample, and a block of a power of two is as stratified as the first.

    With a `box`, the passes have its pixels alone, which are bit for bit those of the whole frame. A ValueError reports
    a box of less than 4 pixels along a side, which Blender does not render.
    """
    scene.cycles.samples = 2 * samples
    scene.cycles.use_sample_subset = True
    scene.cycles.sample_offset = scene.cycles.sample_subset_length = samples
    if box is None:
        return _render(scene, seed)
    with _bordered(scene.render, box):
        return _render(scene, seed)


def render_whole(scene: Any, samples: int, seed: int = 0) -> dict[str, NDArray[np.float32]]:
    """Render as `render_passes`, but with the first block of samples, as Cycles does."""
    scene.cycles.samples = samples
    scene.cycles.use_sample_subset = False
    return _render(scene, seed)


def render_features(scene: Any, samples: int) -> dict[str, NDArray[np.float32]]:
    """Render with Cycles' own passes for a denoiser, ``Denoising Albedo`` and ``Denoising Normal``."""
    layer = scene.view_layers[0].cycles
    layer.denoising_store_passes = True
    try:
        return render_whole(scene, samples)
    finally:
        layer.denoising_store_passes = False


def fill_tables(scene: Any) -> None:
    """Make Cycles' table of sample points as long as it ever is.

    It grows with the most samples that were rendered, and what it has for fewer changes as it does: a frame would
    depend on the rounds, passes and frames that the process rendered before it.
    """
    scene.cycles.samples = _LONGEST_TABLE
    scene.cycles.use_sample_subset = True
    # Cycles renders the first sample by itself, and whether it sorts mattes after it goes by the render before. Where
    # that is the whole of a render without mattes after one with them, it sorts what lies behind the pixels.
    scene.cycles.sample_offset, scene.cycles.sample_subset_length = 0, 2
    with _bordered(scene.render, (0, 0, SMALLEST, SMALLEST)), _untold():
        _render(scene, seed=0)


def compile_shaders(scene: Any) -> None:
    """Render a tiny picture of a scene, whose compiled shaders persistent data keeps for its frames."""
    render = scene.render
    size = render.resolution_x, render.resolution_y
    render.resolution_x = render.resolution_y = SMALLEST
    try:
        render_whole(scene, samples=1)
    finally:
        render.resolution_x, render.resolution_y = size


@contextmanager
def _bordered(render: Any, box: Box) -> Iterator[None]:
    left, bottom, right, top = box
    if min(right - left, top - bottom) < SMALLEST:
        raise ValueError(f"a box has at least {SMALLEST} pixels along a side, found: {box}")
    width, height = render.resolution_x, render.resolution_y
    # Borders are numbers of 32 bits, cut to whole pixels: a quarter of a pixel keeps them from the next.
    render.border_min_x, render.border_max_x = (left + 0.25) / width, (right + 0.25) / width
    render.border_min_y, render.border_max_y = (bottom + 0.25) / height, (top + 0.25) / height
    render.use_border = render.use_crop_to_border = True
    try:
        yield
    finally:
        render.use_border = render.use_crop_to_border = False


@contextmanager
def _untold() -> Iterator[None]:
    """Keep a render's statistics from those who report the progress of frames."""
    told = bpy.app.handlers.render_stats
    kept = list(told)
    told.clear()
    try:
        yield
    finally:
        told.extend(kept)


def _render(scene: Any, seed: int) -> dict[str, NDArray[np.float32]]:
    scene.cycles.seed = seed
    # Cycles' settings are custom properties: without the tag a later render keeps the old ones.
    scene.update_tag()
    Capture.passes = {}
    bpy.ops.render.render(scene=scene.name)
    if not Capture.passes:
        # Blender only prints exceptions of an engine.
        raise RenderError("Blender rendered nothing; its own message is above in the log")
    return Capture.passes


_MOST_COINCIDENT = 64
"""Surfaces in one place that a path may pass through in all."""


def empty_scene() -> Any:
    """Delete all data and return an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.data.scenes[0]


def configure(scene: Any, resolution: tuple[int, int], bounces: int) -> None:
    """Set everything that a picture depends on, for shaders in OSL that integrate the light."""
    render, settings = scene.render, scene.cycles
    _configure_any(scene, resolution)
    render.film_transparent = True
    # With motion blur on and nothing moving, OSL's `time` is the stratified number of a pixel's sample.
    render.use_motion_blur = True
    render.motion_blur_shutter = 1.0
    version.center_motion_blur_on_frame(scene)
    settings.rolling_shutter_type = "NONE"
    settings.device = "CPU"
    settings.shading_system = True
    # Alpha counts rays that do not reach the background; a portal's ray is directed to a hit, so it never does.
    _bounce(settings, reflected=0, transparent=bounces + 1)
    world = bpy.data.worlds.new("black")
    version.empty_node_tree(world)
    world.cycles.sampling_method = "NONE"
    scene.world = world


def configure_closures(
    scene: Any, resolution: tuple[int, int], bounces: int, device: str, *, see_through: bool = False
) -> None:
    """Set everything that a picture depends on but its world, for Cycles' own closures.

    A `see_through` surface counts as a bounce, as in the OSL. Without one, rays pass only what coincides with the
    surface that they leave. A RenderError reports a device that is not there.
    """
    _configure_nodes(scene, resolution, device)
    scene.render.film_transparent = True
    _bounce(scene.cycles, reflected=bounces, transparent=bounces if see_through else _MOST_COINCIDENT)


def configure_portals(scene: Any, resolution: tuple[int, int], bounces: int, device: str) -> None:
    """Set everything that a picture depends on but its world, for surfaces that send all light through ray portals.

    The rays of portals are rays of the camera, which see no world with a transparent film. Coverage is instead the
    third channel of the pass of texture coordinates, 1 on a surface. A RenderError reports a device that is not there.
    """
    _configure_nodes(scene, resolution, device)
    scene.render.film_transparent = False
    scene.view_layers[0].use_pass_uv = True
    _bounce(scene.cycles, reflected=0, transparent=bounces + 1)
    # Paths are short: Russian roulette adds more noise than it saves time.
    scene.cycles.min_transparent_bounces = bounces + 1


def _configure_nodes(scene: Any, resolution: tuple[int, int], device: str) -> None:
    settings = scene.cycles
    _configure_any(scene, resolution)
    scene.render.use_motion_blur = False
    settings.shading_system = False
    # Each seed has a scramble of its own, so that two renders are independent.
    settings.sampling_pattern = "TABULATED_SOBOL"
    settings.direct_light_sampling_type = "MULTIPLE_IMPORTANCE_SAMPLING"
    # The threshold is in units of radiance: a dim light would be noisier than a bright one.
    settings.light_sampling_threshold = 0.0
    settings.caustics_reflective = settings.caustics_refractive = True
    settings.blur_glossy = 0.0
    settings.use_fast_gi = False
    settings.film_transparent_glass = False
    settings.texture_limit_render = "OFF"
    _use_device(settings, device)


def _configure_any(scene: Any, resolution: tuple[int, int]) -> None:
    """Set what all backends share; Blender's defaults change between versions."""
    render, settings, layer = scene.render, scene.cycles, scene.view_layers[0]
    render.engine = _ENGINE
    render.resolution_x, render.resolution_y = resolution
    render.resolution_percentage = 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_border = render.use_crop_to_border = render.use_compositing = render.use_sequencer = False
    render.use_persistent_data = True
    render.use_simplify = False
    render.threads_mode = "AUTO"  # one for each core that the process may use

    settings.use_adaptive_sampling = settings.use_denoising = False
    settings.time_limit = 0.0
    settings.use_animated_seed = False
    settings.auto_scrambling_distance = False
    settings.scrambling_distance = 1.0
    settings.use_light_tree = False
    settings.use_auto_tile = False
    settings.use_guiding = False
    settings.sample_clamp_direct = settings.sample_clamp_indirect = 0.0
    settings.film_exposure = 1.0
    settings.pixel_filter_type = "BOX"
    settings.filter_width = 1.0

    for name in dir(layer):
        if name.startswith("use_pass_") and not layer.is_property_readonly(name):
            setattr(layer, name, False)
    layer.use_pass_combined = True
    layer.pass_alpha_threshold = 0.0
    layer.samples = 0


def _bounce(settings: Any, reflected: int, transparent: int) -> None:
    settings.max_bounces = settings.diffuse_bounces = settings.glossy_bounces = reflected
    settings.transmission_bounces = reflected
    settings.volume_bounces = 0
    settings.transparent_max_bounces = transparent
    settings.min_light_bounces = settings.min_transparent_bounces = 0


def _use_device(settings: Any, device: str) -> None:
    """Render on all devices of a kind, or on the CPU."""
    settings.device = "CPU"
    if device == "cpu":
        return
    preferences = bpy.context.preferences.addons["cycles"].preferences
    kinds = [kind for kind, *_ in preferences.get_device_types(bpy.context) if kind != "NONE"]
    there = {each.type for kind in kinds for each in preferences.get_devices_for_type(kind)} - {"CPU"}
    if device.upper() not in there:
        found = ", ".join(sorted(["cpu", *(kind.lower() for kind in there)]))
        raise RenderError(f"Cycles finds no device of the kind '{device}' on this machine; it finds: {found}")
    preferences.compute_device_type = device.upper()
    for each in preferences.get_devices_for_type(device.upper()):
        each.use = each.type == device.upper()
    settings.device = "GPU"
