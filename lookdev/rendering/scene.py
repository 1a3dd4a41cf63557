"""From a scene to the task that a worker renders."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from lookdev.asset import Asset, save_asset
from lookdev.cache import Content
from lookdev.codegen import TANGENT, Catching, Source
from lookdev.codegen.setting import SourceSetting
from lookdev.errors import CodegenError, EnvironmentMapError
from lookdev.light import Light, lights_code
from lookdev.light.lamps import CodedRig
from lookdev.light.link import MOST_GROUPS
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.kept import kept_source
from lookdev.rendering.passes import LIGHTS, light_groups
from lookdev.rendering.task import SceneTask
from lookdev.scene import Sampling, Scene

Generated = dict[tuple[object, ...], Source]
"""Sources by what they were generated for. The looks among it, by their ids, must live as long."""


def scene_task(
    scene: Scene,
    sampling: Sampling,
    backend: str = "exact",
    device: str = "cpu",
    generated: Generated | None = None,
) -> SceneTask:
    """Generate the sources of a scene, but for those in `generated`, to which they are added.

    Reflected light does not reach a convex asset again, so it is rendered without bounces and shadow rays, unless it is
    closed and a look transmits. Lights that reach nothing are left out. Raises CodegenError or EnvironmentMapError,
    a line each, where the backend cannot show a look or lights.
    """
    # A light that reaches nothing is a black layer.
    named = light_groups(scene.lights) if LIGHTS in sampling.passes else ()
    scene = scene.without_idle_lights()
    record, asset = BACKENDS[backend], scene.asset
    # Slots that share a look, and are lit by the same lights, share its source.
    worn_by = [(id(look), lit) for look, lit in zip(scene.looks, scene.lit_by, strict=True)]
    caught = {id(scene.wears[path]) for path in scene.catchers}
    if caught and not record.catches:
        raise CodegenError(f"backend '{backend}' renders no shadow catcher: 'exact' does")
    different = dict(zip(worn_by, scene.looks, strict=True))
    for look in different.values():
        if reason := record.cannot_show(look):
            raise CodegenError(reason)
    if not record.any_light and (gaps := record.cannot_light(scene.lights)):
        raise EnvironmentMapError("\n".join(f"{gap}: backend 'exact' renders it, '{backend}' does not" for gap in gaps))

    if max(scene.grouped) > MOST_GROUPS:
        raise EnvironmentMapError(
            f"shadow links divide the parts into {max(scene.grouped) + 1} groups that cast the shadows of different "
            f"lights; at most {MOST_GROUPS + 1} would be right"
        )
    known: Generated = {} if generated is None else generated
    groups = light_groups(scene.lights) if LIGHTS in sampling.passes else ()
    numbers_of_groups = {name: number for number, name in enumerate(dict.fromkeys((*groups, *named)))}
    # The files of a light are values that a source is given, so lights of one kind and size have one source.
    by_light = record.any_light and sampling.ibl_samples != 0

    def lit_as(lights: Sequence[Light]) -> tuple[object, ...]:
        sampled = by_light and not all(light.constant for light in lights)
        kinds = tuple((light.kind, light.constant) for light in lights)
        return kinds, lights_code(lights, sampled=sampled).constants if record.any_light else ()

    lit_by = {lit: tuple(scene.lights[number] for number in lit) for _, lit in different}
    grouped = {lit: tuple(numbers_of_groups[groups[each]] for each in lit) if groups else () for lit in lit_by}
    like = {lit: (*lit_as(lights), grouped[lit]) if groups else lit_as(lights) for lit, lights in lit_by.items()}

    def generate(sampling: Sampling, shadows: bool) -> list[Source]:
        sources = []
        for (number, lit), look in different.items():
            catching: Catching = "" if not caught else "ground" if number in caught else "asset"
            setting = SourceSetting(lit_by[lit], scene.film.resolution, sampling, shadows, catching)
            setting = replace(setting, light_groups=grouped[lit], space=scene.film.space)
            key = (number, backend, *like[lit], setting.resolution, sampling, shadows, setting.space, catching)
            if key not in known:
                known[key] = kept_source(record, look, setting, like[lit])
            sources.append(known[key])
        return sources

    chosen = replace(sampling, bounces=0) if asset.convex else sampling
    sources = generate(chosen, shadows=not asset.convex)
    if asset.convex and not asset.sheet and any(each.transmits or each.see_through for each in sources):
        chosen = sampling
        sources = generate(sampling, shadows=True)
    for source, (_, lit) in zip(sources, different, strict=True):
        rig = CodedRig.of(lit_by[lit])
        if source.see_through and (rig.shadowed or rig.spared):
            raise CodegenError(
                f"look '{source.name}': can be seen through, so lights whose shadows have a colour or an end, or that "
                "cast none or only those of some parts, cannot light it; black shadows of all lights would be right"
            )
    # Equal looks of two materials have one source, unless messages name them differently.
    kept = {(source.name, source.digest, lit): source for (_, lit), source in zip(different, sources, strict=True)}
    numbers = {key: number for number, key in enumerate(kept)}
    worn = {key: numbers[source.name, source.digest, key[1]] for key, source in zip(different, sources, strict=True)}
    shaders, slots = tuple(kept.values()), tuple(worn[key] for key in worn_by)
    return SceneTask(
        asset=Content.of(save_asset(asset, _directed(asset, [shaders[number] for number in slots]))),
        backend=backend,
        shaders=shaders,
        worn=slots,
        lights=scene.lights,
        lit=tuple(lit for _, _, lit in kept) if scene.lit else (),
        groups=scene.grouped if scene.groups else (),
        resolution=scene.film.resolution,
        space=scene.film.space,
        sampling=chosen,
        prims=tuple(each.path for each in asset.instances) if "cryptomatte" in chosen.passes else (),
        light_groups=(*groups, *(name for name in named if name not in groups)),
        camera=scene.camera,
        device=device,
    )


def _directed(asset: Asset, worn: Sequence[Source]) -> Iterator[int]:
    """Yield the numbers of meshes whose tangents are read by a source that one of their slots wears."""
    reading = np.array([any(each.attribute == TANGENT for each in source.attributes) for source in worn])
    if reading.any():
        yield from (number for number, mesh in enumerate(asset.meshes) if reading[mesh.face_slots].any())
