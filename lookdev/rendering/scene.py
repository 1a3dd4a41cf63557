"""Generates the task of a scene: the code or nodes of each look, and all other data that a worker needs to render it.

A slot is a part of an asset to which one material is assigned. A source is the code or the nodes of a look.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.asset import Asset, save_asset
from lookdev.cache import Content
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import TANGENT, Catching, GeneratedSource
from lookdev.errors import CodegenError, EnvironmentMapError
from lookdev.light import Light, lights_code
from lookdev.light.emission import MAX_SHADOW_GROUPS, WHITE
from lookdev.material import Look
from lookdev.rendering.backends import BACKENDS, Backend
from lookdev.rendering.passes import LIGHTS_PASS, light_groups
from lookdev.rendering.source_cache import cached_source
from lookdev.rendering.task import SceneTask
from lookdev.scene import Sampling, Scene


def scene_task(scene: Scene, sampling: Sampling, backend: str = "exact", device: str = "cpu") -> SceneTask:
    """Return the task of a single scene, as `SceneTasks.task`."""
    return SceneTasks(backend, device).task(scene, sampling)


class SceneTasks:
    """Generates the tasks of scenes for a backend. A source that several scenes need is generated once."""

    def __init__(self, backend: str = "exact", device: str = "cpu") -> None:
        self._backend = BACKENDS[backend]
        self._device = device
        # The look is stored beside its source, so that the look's id stays in use and no other look gets the same id.
        self._sources: dict[tuple[object, ...], tuple[GeneratedSource, Look]] = {}

    def task(self, scene: Scene, sampling: Sampling) -> SceneTask:
        """Generate the sources of a scene, and return its task.

        A convex asset is rendered without bounces and shadow rays, because light that it reflects does not hit it
        again. The exception is a closed convex asset with a look that transmits light or can be seen through. Lights
        that reach no part of the asset are left out.

        Raises
        ------
        CodegenError
            The backend cannot render a look, a shadow catcher, or a look that can be seen through under these lights.
        EnvironmentMapError
            The backend cannot render some lights; the message has a line for each.
        """
        every_group = light_groups(scene.lights) if LIGHTS_PASS in sampling.passes else ()  # also of idle lights
        scene = scene.without_idle_lights()  # the pass of a light that reaches nothing is black
        self._check_support(scene)
        surfaces, surface_of_slot = _distinct_surfaces(scene)
        groups = light_groups(scene.lights) if LIGHTS_PASS in sampling.passes else ()
        layers = tuple(dict.fromkeys((*groups, *every_group)))
        layer_of_light = tuple(layers.index(group) for group in groups)
        # Many surfaces share a set of lights, so the code of the lights is generated once for each set.
        lights = {surface.lights: tuple(scene.lights[number] for number in surface.lights) for surface in surfaces}
        codes = {
            numbers_of_lights: _light_code(reaching, self._backend, sampling)
            for numbers_of_lights, reaching in lights.items()
        }

        def generate(sampling: Sampling, shadows: bool) -> list[GeneratedSource]:
            """Return the source of each surface."""
            sources = []
            for surface in surfaces:
                group_numbers = tuple(layer_of_light[number] for number in surface.lights) if layer_of_light else ()
                setting = SourceSetting(lights[surface.lights], scene.film.resolution, sampling, shadows)
                setting = replace(
                    setting, catching=surface.catching, light_groups=group_numbers, space=scene.film.space
                )
                code = codes[surface.lights]
                sources.append(self._source(surface.look, setting, (*code, group_numbers) if group_numbers else code))
            return sources

        asset = scene.asset
        effective = replace(sampling, bounces=0) if asset.convex else sampling
        sources = generate(effective, not asset.convex)
        # A sheet is convex and flat: light that it transmits does not hit it again, either.
        if asset.convex and not asset.sheet and any(source.transmits or source.see_through for source in sources):
            effective = sampling
            sources = generate(effective, True)
        for source, surface in zip(sources, surfaces, strict=True):
            _check_shadows(source, lights[surface.lights])
        # Equal looks of two materials share a source, unless their names in messages differ.
        keys = [(source.name, source.digest, surface.lights) for source, surface in zip(sources, surfaces, strict=True)]
        sources_by_key = dict(zip(keys, sources, strict=True))
        numbers = {key: number for number, key in enumerate(sources_by_key)}
        shaders, slots = tuple(sources_by_key.values()), tuple(numbers[keys[surface]] for surface in surface_of_slot)
        return SceneTask(
            asset=Content.store_copy(
                save_asset(asset, _meshes_with_tangents(asset, [shaders[number] for number in slots]))
            ),
            backend=self._backend.name,
            shaders=shaders,
            slot_shaders=slots,
            lights=scene.lights,
            shader_lights=tuple(lights for _, _, lights in sources_by_key) if scene.lights_of_slot else (),
            groups=scene.slot_groups if scene.groups else (),
            resolution=scene.film.resolution,
            space=scene.film.space,
            sampling=effective,
            prims=tuple(instance.path for instance in asset.instances) if "cryptomatte" in effective.passes else (),
            light_groups=(*groups, *(group for group in every_group if group not in groups)),
            camera=scene.camera,
            device=self._device,
        )

    def _check_support(self, scene: Scene) -> None:
        """Raise the errors of `task` that are known before sources are generated."""
        backend = self._backend
        if scene.catchers and not backend.can_catch_shadows:
            raise CodegenError(f"backend '{backend.name}' renders no shadow catcher: 'exact' does")
        for look in {id(look): look for look in scene.looks}.values():
            if reason := backend.look_gap(look):
                raise CodegenError(reason)
        if not backend.any_light and (gaps := backend.light_gaps(scene.lights)):
            lines = (f"{gap}: backend 'exact' renders it, '{backend.name}' does not" for gap in gaps)
            raise EnvironmentMapError("\n".join(lines))
        if (groups := max(scene.slot_groups)) > MAX_SHADOW_GROUPS:
            raise EnvironmentMapError(
                f"shadow links divide the parts into {groups + 1} groups that cast the shadows of different lights; at "
                f"most {MAX_SHADOW_GROUPS + 1} would be right"
            )

    def _source(self, look: Look, setting: SourceSetting, code: tuple[object, ...]) -> GeneratedSource:
        """Return the source of a look. `code` has everything about the lights that the source depends on."""
        settings = setting.resolution, setting.sampling, setting.shadows, setting.space, setting.catching
        key = (id(look), *code, *settings)
        if key not in self._sources:
            self._sources[key] = cached_source(self._backend, look, setting, code), look
        return self._sources[key][0]


@dataclass(frozen=True, eq=False)
class _Surface:
    """A look together with the lights of its slots. Slots with equal surfaces share a source."""

    look: Look
    lights: tuple[int, ...]  # the numbers of the lights that reach the slots, indices into `Scene.lights`
    catching: Catching  # in a scene with a shadow catcher: whether the look is on the ground or on the asset


def _distinct_surfaces(scene: Scene) -> tuple[list[_Surface], list[int]]:
    """Return the different surfaces of a scene, and the number of each slot's surface."""
    catching_looks = {id(scene.look_of_slot[path]) for path in scene.catchers}
    surfaces: dict[tuple[int, tuple[int, ...]], _Surface] = {}
    keys = [(id(look), lights) for look, lights in zip(scene.looks, scene.slot_lights, strict=True)]
    for key, look in zip(keys, scene.looks, strict=True):
        catching: Catching = "" if not catching_looks else "ground" if key[0] in catching_looks else "asset"
        surfaces[key] = _Surface(look, key[1], catching)
    numbers = {key: number for number, key in enumerate(surfaces)}
    return list(surfaces.values()), [numbers[key] for key in keys]


def _light_code(lights: Sequence[Light], backend: Backend, sampling: Sampling) -> tuple[object, ...]:
    """Return everything about some lights that a source depends on, such as kinds and sizes.

    The files of lights are inputs of the generated code, and therefore not part of it.
    """
    kinds = tuple((light.kind, light.constant) for light in lights)
    if not backend.any_light:
        return kinds, ()
    sampled = sampling.ibl_samples != 0 and not all(light.constant for light in lights)
    return kinds, lights_code(lights, sampled=sampled).constants


def _check_shadows(source: GeneratedSource, lights: Sequence[Light]) -> None:
    """Raise CodegenError if a look can be seen through and a light does not cast plain black shadows of all parts."""
    emissions = [light.emission for light in lights]
    if source.see_through and any(
        emission.shadow != WHITE.shadow or emission.shadow_excluded for emission in emissions
    ):
        raise CodegenError(
            f"look '{source.name}': can be seen through, so lights whose shadows have a colour or an end, or that "
            "cast none or only those of some parts, cannot light it; black shadows of all lights would be right"
        )


def _meshes_with_tangents(asset: Asset, sources: Sequence[GeneratedSource]) -> Iterator[int]:
    """Yield the numbers of the meshes that need tangents: those with a slot whose source reads tangents.

    `sources` has the source of each slot.
    """
    reads_tangents = np.array(
        [any(attribute.attribute == TANGENT for attribute in source.attributes) for source in sources]
    )
    if reads_tangents.any():
        yield from (number for number, mesh in enumerate(asset.meshes) if reads_tangents[mesh.face_slots].any())
