"""Builds the scenes of a job: `build_scenes` runs all steps, which are in the other modules of `lookdev.build`.

The steps are: expand looks with variants ``"*"`` and wedges; read lights, materials and the asset; assign looks to
parts; refine the geometry and frame it with cameras; link lights to parts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from lookdev.asset import Asset
from lookdev.build.assets import AssetReader, ComposedAsset
from lookdev.build.assign import AssignedAsset, assign_looks, read_materials
from lookdev.build.expand import expand_looks
from lookdev.build.faults import Findings
from lookdev.build.frame import job_grounds, read_shot, refine_and_frame
from lookdev.build.lights import RigLights, read_lights, vary_lights
from lookdev.build.wedges import Wedges, WedgeSheet, expand_wedges, vary_looks
from lookdev.errors import shorten
from lookdev.job.schema import MAX_FRAMES, SEVERAL_JOBS_HINT, Job
from lookdev.light import Light
from lookdev.material import Look
from lookdev.scene import Camera, Film, Scene
from lookdev.scene.charts.props import props_camera, props_scene
from lookdev.scene.ground import GROUND_PATH, add_ground
from lookdev.scene.scene import link_lights

PrepareAhead = Callable[[Job, Look, tuple[Light, ...]], None]
"""A callback that can prepare a render. It gets the job, and a look and lights that the job will probably render."""


@dataclass(frozen=True)
class JobScenes:
    """The scenes of a job. A rig is an ``[[ibl]]`` or a ``[[rig]]``."""

    job: Job  # expanded: each variant is a separate look, and so is each look of a wedge
    scenes: Mapping[tuple[str, str], Scene]  # by the names of look and rig, in the order of the looks
    look_keys: Mapping[str, str]  # the key in the job file of each look, by its name
    notes: tuple[str, ...]  # for the user, without duplicates
    rig_keys: Mapping[str, str]  # the key in the job file of each rig, by its name
    sheets: tuple[WedgeSheet, ...]  # the contact sheets of wedges
    charts: Mapping[str, Scene] = field(default_factory=dict)  # the scenes of reference props, by the name of the rig


def build_scenes(
    job: Job,
    ahead: PrepareAhead = lambda job, look, lights: None,
    reader: AssetReader | None = None,
    *,
    sampled: bool = True,
) -> JobScenes:
    """Read the files of a job and return its scenes; raise FaultsError with all faults of all files.

    Parameters
    ----------
    ahead
        A callback that can prepare a render. It is called after lights and materials are read, and before the asset is
        read. It is not called if there are faults, if no look has a material of its own, or if every rig is fitted to
        the asset.
    reader
        The reader of the job's asset, if the asset has been read already.
    sampled
        Whether domes have tables with which shaders draw directions. Backends that use the renderer's own lights need
        none.
    """
    findings = Findings(job)
    reader = reader or AssetReader(job.asset)
    job, look_keys = expand_looks(job, reader, findings)
    lights = read_lights(job, findings, sampled=sampled)
    wedges = expand_wedges(job, findings)
    _check_frames(job, wedges, findings)
    materials = {look.name: read_materials(look, look_keys[look.name], findings) for look in job.look}
    job, rigs, rig_keys = vary_lights(job, wedges, lights, findings, sampled=sampled)
    for name, variation in wedges.looks.items():
        materials[name] = vary_looks(materials[variation.base], variation, findings)
    # The last result of `read_materials` for a look comes from its `material`, else from its last `assign`.
    own_looks = [looks[-1] for looks in materials.values() if looks]
    placed_lights = [rig.lights for rig in rigs if not rig.is_fitted]
    if not findings.faults and own_looks and placed_lights:
        ahead(job, own_looks[0], placed_lights[0])
    composed = _read_assets(job, reader, look_keys, findings)
    job = _add_varied_looks(job, wedges)
    look_keys |= {name: variation.key for name, variation in wedges.looks.items()}
    composed |= {
        name: composed[variation.base] for name, variation in wedges.looks.items() if variation.base in composed
    }
    assigned: dict[str, AssignedAsset] = {}
    for look in job.look:
        name, key = look.name, look_keys[look.name]
        with findings.collect(key):
            if name in composed:
                assigned[name] = assign_looks(look, materials[name], composed[name], key, findings)
    findings.raise_faults()
    with findings.collect("camera.usd"):
        shot = read_shot(job, next(iter(composed.values())))
    findings.raise_faults()
    assets, cameras = refine_and_frame(job, assigned, shot, look_keys, findings)
    looks = {name: assigned_asset.looks for name, assigned_asset in assigned.items()}
    parts = {path for asset in composed.values() for path in asset.paths}
    scenes = _make_scenes(job, _RenderedAssets(assets, looks, cameras, parts), rigs, wedges, findings)
    rig_names = {rig for _, rig in scenes}
    charts = _make_chart_scenes(job, assets, cameras, [rig for rig in rigs if rig.name in rig_names], findings)
    notes = tuple(dict.fromkeys(map(shorten, findings.notes)))
    return JobScenes(job, scenes, look_keys, notes, rig_keys, wedges.sheets, charts)


@dataclass(frozen=True)
class _RenderedAssets:
    """The refined assets of a job, with their looks and cameras.

    The keys of `assets`, `looks` and `cameras` are the names of the job's looks. A value of `looks` maps the path of
    each slot to its look. `parts` has the paths of all parts of all assets.
    """

    assets: Mapping[str, Asset]
    looks: Mapping[str, Mapping[str, Look]]
    cameras: Mapping[str, Camera]
    parts: set[str]


def _check_frames(job: Job, wedges: Wedges, findings: Findings) -> None:
    """Raise FaultsError if wedges make more frames than a job can have."""
    count = len(wedges.pairs) * sum(turntable.frames for turntable in job.turntable)
    if count > MAX_FRAMES and job.wedge:
        problem = f"wedges make {count} frames of the job; at most {MAX_FRAMES} would be right"
        findings.add("wedge", problem, SEVERAL_JOBS_HINT)
        findings.raise_faults()


def _read_assets(
    job: Job, reader: AssetReader, look_keys: Mapping[str, str], findings: Findings
) -> dict[str, ComposedAsset]:
    """Return the asset as each look of a job composes it, by the look's name; an asset with faults is left out."""
    composed = {}
    for look in job.look:
        with findings.collect(f"{look_keys[look.name]}.layer" if look.layer else "asset"):
            composed[look.name] = reader.read(look)
            findings.note(*composed[look.name].asset.notes)
    return composed


def _add_varied_looks(job: Job, wedges: Wedges) -> Job:
    """Return the job with a ``[[look]]`` for each look that its wedges add."""
    tables = {look.name: look for look in job.look}
    for name, variation in wedges.looks.items():
        tables[name] = tables[variation.base].model_copy(update={"name": name})
    return job.model_copy(update={"look": tuple(tables.values())})


def _make_scenes(
    job: Job, rendered: _RenderedAssets, rigs: Sequence[RigLights], wedges: Wedges, findings: Findings
) -> dict[tuple[str, str], Scene]:
    """Return the scene of each look under each rig: with the ground, and with lights linked to parts."""
    film = Film(job.render.resolution, job.render.space)
    assets_and_looks = {name: (asset, rendered.looks[name]) for name, asset in rendered.assets.items()}
    parts, catchers = rendered.parts, frozenset[str]()
    if job.ground is not None:
        with findings.collect("ground"):
            for name, ground in job_grounds(job.ground, rendered.assets, rendered.cameras, findings).items():
                assets_and_looks[name] = add_ground(*assets_and_looks[name], ground, rendered.cameras[name].pivot)
        parts = parts | {GROUND_PATH}
        catchers = frozenset([GROUND_PATH] if job.ground.kind == "catcher" else [])
    findings.raise_faults()
    for rig in rigs:
        findings.note(*rig.link_notes(parts))
    largest = _largest(rendered.assets)
    lights = {rig.name: rig.place_around(rendered.assets[largest]) for rig in rigs}
    scenes = {}
    for name, (asset, looks) in assets_and_looks.items():
        for rig in rigs:
            if (name, rig.name) in wedges.pairs:
                scene = Scene(asset, looks, lights[rig.name], rendered.cameras[name], film, catchers=catchers)
                scenes[name, rig.name] = link_lights(scene)
    return scenes


def _make_chart_scenes(
    job: Job, assets: Mapping[str, Asset], cameras: Mapping[str, Camera], rigs: Sequence[RigLights], findings: Findings
) -> dict[str, Scene]:
    """Return the scene of the reference props under each rig, by the rig's name; empty if the job has no props."""
    charts = {}
    if job.charts is not None:
        name = _largest(assets)
        with findings.collect("charts"):
            camera, strip = props_camera(cameras[name], assets[name].center), job.charts.strip(job.render.resolution)
            findings.note(*filter(None, [strip.size_note()]))
            for rig in rigs:
                lights = rig.place_around(assets[name])
                charts[rig.name] = props_scene(strip, camera, lights, job.render.space)
        findings.raise_faults()
    return charts


def _largest(assets: Mapping[str, Asset]) -> str:
    """Return the name of the look with the largest asset, around which the fitted rigs of all looks are placed."""
    return max(assets, key=lambda name: assets[name].radius)
