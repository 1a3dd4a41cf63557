"""Runs Cycles: sets every setting of a Blender scene, renders it, and returns the pixels of its passes."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path

import bpy
import numpy as np

from lookdev.arrays import Floats32
from lookdev.cycles import version
from lookdev.errors import RenderError

sys.path.append(str(Path(bpy.utils.resource_path("LOCAL")) / "scripts" / "addons_core"))
import cycles

_ENGINE = "LOOKDEV_CYCLES"
MIN_SIDE = 4
"""The least number of pixels along a side of a picture that Blender renders."""

# The number of samples whose points Cycles tabulates. Further samples repeat these points, shuffled.
_SAMPLE_TABLE_LENGTH = 8192

PixelBounds = tuple[int, int, int, int]
"""A rectangle of pixels: left, bottom, right and top, counted from the lower left corner of the frame."""


class CaptureEngine(cycles.CyclesRender):  # type: ignore[misc]
    """A render engine that is Cycles under another name; it also copies the passes of a render to memory."""

    bl_idname = _ENGINE
    bl_label = "lookdev"

    # The passes of the last render, by Blender's names. They are on the class, because Blender creates the instances.
    passes: dict[str, Floats32] = {}  # noqa: RUF012

    def update_script_node(self, node: bpy.types.Node) -> None:
        """Do nothing: `lookdev.cycles.shaders` adds the sockets, so that Blender need not parse the shader."""

    def render(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Render, then copy every pass as an array (height, width, channels), rows bottom-up."""
        super().render(depsgraph)
        result = self.get_result()
        width, height = result.resolution_x, result.resolution_y
        for render_pass in result.layers[0].passes:
            pixels = np.empty(width * height * render_pass.channels, dtype=np.float32)
            render_pass.rect.foreach_get(pixels)
            CaptureEngine.passes[render_pass.name] = pixels.reshape(height, width, render_pass.channels)


bpy.utils.register_class(CaptureEngine)


def render_passes(
    scene: bpy.types.Scene, samples: int, seed: int = 0, box: PixelBounds | None = None
) -> dict[str, Floats32]:
    """Render a scene with `samples` per pixel; return its passes by Blender's names, rows bottom-up.

    Cycles places sample 0 of every pixel at the pixel's centre, which would bias coverage by up to half a sample.
    Therefore the second block of `samples` samples of the sequence is rendered, which does not contain sample 0. If the
    size of the blocks is a power of two, the second block is as stratified as the first.

    With a `box`, the passes have only the pixels of the box. These are bit for bit equal to pixels of the whole frame.
    Raises ValueError if the box has fewer than `MIN_SIDE` pixels along a side, as Blender does not render such a box.
    """
    scene.cycles.samples = 2 * samples
    scene.cycles.use_sample_subset = True
    scene.cycles.sample_offset = scene.cycles.sample_subset_length = samples
    with nullcontext() if box is None else _crop_render(scene.render, box):
        return _render(scene, seed)


def render_whole(scene: bpy.types.Scene, samples: int, seed: int = 0) -> dict[str, Floats32]:
    """Render the whole frame like `render_passes`, but with the first samples of the sequence, as Cycles does."""
    scene.cycles.samples = samples
    scene.cycles.use_sample_subset = False
    return _render(scene, seed)


def render_features(scene: bpy.types.Scene, samples: int) -> dict[str, Floats32]:
    """Render Cycles' own guides of a denoiser: the passes ``Denoising Albedo`` and ``Denoising Normal``."""
    with override_settings(scene.view_layers[0].cycles, {"denoising_store_passes": True}):
        return render_whole(scene, samples)


def fill_sample_table(scene: bpy.types.Scene) -> None:
    """Make Cycles compute its table of sample points at full length.

    The table grows to the largest number of samples rendered so far, and its first entries change when it grows. If the
    table were not full, a frame would depend on everything that the process rendered before.
    """
    scene.cycles.samples = _SAMPLE_TABLE_LENGTH
    scene.cycles.use_sample_subset = True
    # Two samples avoid a bug of Cycles. It renders the first sample separately, and sorts mattes after it if the
    # previous render had mattes. If this render has no mattes and one sample, Cycles sorts memory beyond the pixels.
    scene.cycles.sample_offset, scene.cycles.sample_subset_length = 0, 2
    with _crop_render(scene.render, (0, 0, MIN_SIDE, MIN_SIDE)), _mute_statistics():
        _render(scene, seed=0)


def compile_shaders(scene: bpy.types.Scene) -> None:
    """Render a tiny picture of a scene. Blender's persistent data then has the compiled shaders for later frames."""
    with override_settings(scene.render, {"resolution_x": MIN_SIDE, "resolution_y": MIN_SIDE}):
        render_whole(scene, samples=1)


@contextmanager
def override_settings(owner: object, values: Mapping[str, object]) -> Iterator[None]:
    """In the block, change settings of Blender, attributes of `owner`; restore them afterwards, also after an error."""
    before = {name: getattr(owner, name) for name in values}
    try:
        for name, value in values.items():
            setattr(owner, name, value)
        yield
    finally:
        for name, value in before.items():
            setattr(owner, name, value)


def _crop_render(render: bpy.types.RenderSettings, box: PixelBounds) -> AbstractContextManager[None]:
    """Return a context in which renders are restricted to a box of the frame."""
    left, bottom, right, top = box
    if min(right - left, top - bottom) < MIN_SIDE:
        raise ValueError(f"a box has at least {MIN_SIDE} pixels along a side, found: {box}")
    width, height = render.resolution_x, render.resolution_y
    # Blender stores borders as float32, and truncates them to whole pixels. A quarter of a pixel is added, so that
    # rounding does not move a border to the next pixel.
    borders = {
        "border_min_x": (left + 0.25) / width,
        "border_max_x": (right + 0.25) / width,
        "border_min_y": (bottom + 0.25) / height,
        "border_max_y": (top + 0.25) / height,
    }
    return override_settings(render, {**borders, "use_border": True, "use_crop_to_border": True})


@contextmanager
def _mute_statistics() -> Iterator[None]:
    """In the block, remove the handlers of render statistics, which would report samples as progress of a frame."""
    handlers = bpy.app.handlers.render_stats
    removed = list(handlers)
    handlers.clear()
    try:
        yield
    finally:
        handlers.extend(removed)


def _render(scene: bpy.types.Scene, seed: int) -> dict[str, Floats32]:
    """Render a scene with its present settings; return its passes by Blender's names, rows bottom-up."""
    scene.cycles.seed = seed
    # The settings of Cycles are custom properties. Without this tag, the render would use their old values.
    scene.update_tag()
    CaptureEngine.passes = {}
    bpy.ops.render.render(scene=scene.name)
    if not CaptureEngine.passes:
        # Blender prints an exception of an engine, and does not raise it.
        raise RenderError("Blender rendered nothing; its own message is above in the log")
    return CaptureEngine.passes


_MAX_COINCIDENT = 64
"""The most coincident surfaces that a path may pass through in total."""


def empty_scene() -> bpy.types.Scene:
    """Delete all data and return an empty scene."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.data.scenes[0]


def configure_osl(scene: bpy.types.Scene, resolution: tuple[int, int], bounces: int) -> None:
    """Set everything that a picture depends on, for OSL shaders that integrate the light."""
    render, settings = scene.render, scene.cycles
    _configure_common(scene, resolution)
    render.film_transparent = True
    # Nothing moves, but motion blur is on: OSL's `time` is then a number that is stratified over the samples of a
    # pixel. The shaders derive the index of the sample from it.
    render.use_motion_blur = True
    render.motion_blur_shutter = 1.0
    version.center_motion_blur_on_frame(scene)
    settings.rolling_shutter_type = "NONE"
    settings.device = "CPU"
    settings.shading_system = True
    # Alpha is the share of rays that do not reach the background. Paths continue by ray portals, and such a ray never
    # reaches the background, because it points to a known hit.
    _set_bounces(settings, reflected=0, transparent=bounces + 1)
    world = bpy.data.worlds.new("black")
    version.clear_node_tree(world)
    world.cycles.sampling_method = "NONE"
    scene.world = world


def configure_closures(
    scene: bpy.types.Scene, resolution: tuple[int, int], bounces: int, device: str, *, see_through: bool = False
) -> None:
    """Set everything that a picture depends on, except its world, for Cycles' own closures.

    If surfaces are `see_through`, each surface that a ray passes counts as a bounce, as in the OSL shaders. Otherwise
    rays pass only surfaces that coincide with the surface that they leave. Raises RenderError if the device is missing.
    """
    _configure_nodes(scene, resolution, device)
    scene.render.film_transparent = True
    _set_bounces(scene.cycles, reflected=bounces, transparent=bounces if see_through else _MAX_COINCIDENT)


def configure_portals(scene: bpy.types.Scene, resolution: tuple[int, int], bounces: int, device: str) -> None:
    """Set everything that a picture depends on, except its world, for surfaces that send all light through ray portals.

    The rays of portals are camera rays. With a transparent film, camera rays do not see the world, so the film is
    opaque. The coverage is therefore taken from the third channel of the pass of texture coordinates, which is 1 on a
    surface. Raises RenderError if the device is missing.
    """
    _configure_nodes(scene, resolution, device)
    scene.render.film_transparent = False
    scene.view_layers[0].use_pass_uv = True
    _set_bounces(scene.cycles, reflected=0, transparent=bounces + 1)
    # Russian roulette is off. Paths are short, so it would save little time and add more noise.
    scene.cycles.min_transparent_bounces = bounces + 1


def _configure_nodes(scene: bpy.types.Scene, resolution: tuple[int, int], device: str) -> None:
    """Set the settings that are the same for all materials of native nodes."""
    settings = scene.cycles
    _configure_common(scene, resolution)
    scene.render.use_motion_blur = False
    settings.shading_system = False
    # With this pattern, each seed has a scramble of its own, so that renders with different seeds are independent.
    settings.sampling_pattern = "TABULATED_SOBOL"
    settings.direct_light_sampling_type = "MULTIPLE_IMPORTANCE_SAMPLING"
    # The threshold is off. It is in units of radiance, so a dim light would be noisier than a bright light.
    settings.light_sampling_threshold = 0.0
    settings.caustics_reflective = settings.caustics_refractive = True
    settings.blur_glossy = 0.0
    settings.use_fast_gi = False
    settings.film_transparent_glass = False
    settings.texture_limit_render = "OFF"
    _use_device(settings, device)


def _configure_common(scene: bpy.types.Scene, resolution: tuple[int, int]) -> None:
    """Set the settings that are the same for all backends, also defaults that change between versions of Blender."""
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


def _set_bounces(settings: cycles.properties.CyclesRenderSettings, reflected: int, transparent: int) -> None:
    """Set the most bounces of a path, and the most transparent surfaces or portals that it passes."""
    settings.max_bounces = settings.diffuse_bounces = settings.glossy_bounces = reflected
    settings.transmission_bounces = reflected
    settings.volume_bounces = 0
    settings.transparent_max_bounces = transparent
    settings.min_light_bounces = settings.min_transparent_bounces = 0


def _use_device(settings: cycles.properties.CyclesRenderSettings, device: str) -> None:
    """Set Cycles to render on all devices of a kind such as ``"cuda"``, or on the CPU."""
    settings.device = "CPU"
    if device == "cpu":
        return
    preferences = bpy.context.preferences.addons["cycles"].preferences
    kinds = [kind for kind, *_ in preferences.get_device_types(bpy.context) if kind != "NONE"]
    available = {entry.type for kind in kinds for entry in preferences.get_devices_for_type(kind)} - {"CPU"}
    if device.upper() not in available:
        names = ", ".join(sorted(["cpu", *(kind.lower() for kind in available)]))
        raise RenderError(f"Cycles finds no device of the kind '{device}' on this machine; it finds: {names}")
    preferences.compute_device_type = device.upper()
    for entry in preferences.get_devices_for_type(device.upper()):
        entry.use = entry.type == device.upper()
    settings.device = "GPU"
