"""From a job to its scenes: reads its asset, looks and lights, and puts them together."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from lookdev.asset.usd_camera import UsdCamera, read_camera
from lookdev.build.assets import Assets, Turned
from lookdev.build.assign import NEUTRAL, Dressed, Place, dress_as, lost_notes
from lookdev.build.faults import collected, raise_all
from lookdev.build.frame import rendered
from lookdev.build.ground import job_grounds
from lookdev.build.lights import job_lights, wedge_lights
from lookdev.build.wedges import WedgeSheet, expand_wedges, varied_looks
from lookdev.errors import Fault, FaultsError, shortened
from lookdev.job.parts import JobAssign, JobLook
from lookdev.job.schema import MOST_FRAMES, SEVERAL_JOBS, Job, excess_frames
from lookdev.light import Light
from lookdev.material import Look
from lookdev.material.usd import expand_variants
from lookdev.material.usd.bound import read_any_look
from lookdev.material.variants import MOST_COMBINATIONS
from lookdev.scene import Film, Scene
from lookdev.scene.charts import props_camera, props_scene
from lookdev.scene.ground import PATH as GROUND
from lookdev.scene.ground import on_ground
from lookdev.scene.linking import link_lights
from lookdev.stage import open_stage

Ahead = Callable[[Job, Look, tuple[Light, ...]], None]
"""Is called with a job, and a look and the lights of a rig of it that are likely to be shown."""


@dataclass(frozen=True)
class JobScenes:
    """The scenes of a job, by look and rig, look by look."""

    job: Job  # each variant is a separate look, and so is what a wedge varies
    scenes: Mapping[tuple[str, str], Scene]
    places: Mapping[str, str]  # the key in the job file of each look
    notes: tuple[str, ...]  # for the user, each once
    rig_places: Mapping[str, str]  # the key in the job file of each rig
    sheets: tuple[WedgeSheet, ...]  # of wedges
    charts: Mapping[str, Scene] = field(default_factory=dict)  # of reference props, by rig


def job_scenes(job: Job, ahead: Ahead = lambda job, look, lights: None, assets: Assets | None = None) -> JobScenes:
    """Read the files of a job; raises FaultsError with all faults of all files.

    `assets` are those of the job's asset, where they were read before.

    Lights and materials are read first: `ahead` is called with a look and a rig before the asset is, unless there are
    faults, no look has a material of its own, or every rig waits for the size of the asset.
    """
    notes: list[str] = []
    faults: list[Fault] = []
    assets = assets or Assets(job.asset)
    job, places = _every_variant(job, assets, faults)
    of_shaders: list[Fault] = []
    on_shaders: list[str] = []
    rigs = job_lights(job, on_shaders, of_shaders)
    wedges = expand_wedges(job, of_shaders)
    if (count := len(wedges.pairs) * sum(each.frames for each in job.turntable)) > MOST_FRAMES and job.wedge:
        what = f"wedges make {count} frames of the job; at most {MOST_FRAMES} would be right"
        raise FaultsError([*faults, Fault(str(job.file), "wedge", what, SEVERAL_JOBS)])
    materials = {}
    for look in job.look:
        with collected(job, places[look.name], of_shaders):
            materials[look.name] = _materials(job, look, places[look.name], on_shaders, of_shaders)
    job, more_rigs, rig_places = wedge_lights(job, wedges, rigs, of_shaders)
    rigs += more_rigs
    tables = {look.name: look for look in job.look}
    for name, varied in wedges.looks.items():
        places[name] = varied.place
        if varied.base in materials:
            materials[name] = varied_looks(materials[varied.base], varied, job, of_shaders)
            tables[name] = tables[varied.base].model_copy(update={"name": name})
    own, standing = [each[-1] for each in materials.values() if each], [each.lights for each in rigs if not each.fit]
    if not (faults or of_shaders) and own and standing:
        ahead(job, own[0], standing[0])
    turned = {}
    for look in job.look:
        with collected(job, f"{places[look.name]}.layer" if look.layer else "asset", faults):
            turned[look.name] = assets.turned(look)
            notes += turned[look.name].asset.notes
    turned |= {name: turned[each.base] for name, each in wedges.looks.items() if each.base in turned}
    job = job.model_copy(update={"look": tuple(tables.values())})
    notes += on_shaders
    faults += of_shaders
    dressed: dict[str, Dressed] = {}
    for look in job.look:
        name, place = look.name, places[look.name]
        with collected(job, place, faults):
            if name in turned and name in materials:
                dressed[name] = dress_as(look, materials[name], turned[name], Place(str(job.file), place), faults)
                notes += dressed[name].notes
    raise_all(faults)
    with collected(job, "camera.usd", faults):
        shot = _shot(job, next(iter(turned.values())))
    raise_all(faults)
    shown, cameras = rendered(job, dressed, shot, places, notes)
    largest_of = max(shown, key=lambda name: shown[name].radius)
    largest = shown[largest_of]
    parts = {path for each in turned.values() for path in each.paths}
    film = Film(job.render.resolution, job.render.space)
    placed = {name: (shown[name], each.wears) for name, each in dressed.items()}
    catchers: frozenset[str] = frozenset()
    if job.ground is not None:
        with collected(job, "ground", faults):
            for name, ground in job_grounds(job.ground, shown, cameras, notes).items():
                placed[name] = on_ground(*placed[name], ground, cameras[name].pivot)
        parts.add(GROUND)
        catchers = frozenset([GROUND] if job.ground.kind == "catcher" else [])
    raise_all(faults)
    scenes = {}
    for rig in rigs:
        notes += rig.unlinked(parts)
    for name, (asset, wears) in placed.items():
        for rig in rigs:
            if (name, rig.name) not in wedges.pairs:
                continue
            lights = rig.around(largest)
            linked = link_lights(asset, wears, lights)
            scenes[name, rig.name] = Scene(
                linked.asset, linked.wears, linked.lights, cameras[name], film, linked.lit, linked.groups, catchers
            )
    charts = {}
    if job.charts is not None:
        with collected(job, "charts", faults):
            seen, strip = props_camera(cameras[largest_of], largest.center), job.charts.strip(film.resolution)
            lit = {name for _, name in scenes}
            notes += filter(None, [strip.too_small()])
            charts = {
                rig.name: props_scene(strip, seen, rig.around(largest), film.space) for rig in rigs if rig.name in lit
            }
        raise_all(faults)
    shortly = tuple(dict.fromkeys(map(shortened, notes)))
    return JobScenes(job, scenes, places, shortly, rig_places, wedges.sheets, charts)


def each_variant(
    name: str, file: Path, prim: str | None, variants: Mapping[str, str]
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield name and variants of each look of a choice of a material's variants; raises LookError as `expand_variants`.

    A ``"*"`` stands for every variant of its set; the look of each is named ``<name>_<variant>``.
    """
    yield from _named(name, variants, lambda: expand_variants(file, prim, variants))


def _shot(job: Job, turned: Turned) -> UsdCamera | None:
    """Return the camera that a job names, of the asset as a look composes it, or of another file."""
    if job.camera.usd is None:
        return None
    if job.camera.file is not None:
        return read_camera(open_stage(job.camera.file), job.camera.usd)
    assert turned.composed is not None, "a built-in asset has no camera"
    return read_camera(turned.composed.stage, job.camera.usd)


def _named(
    name: str, variants: Mapping[str, str], expand: Callable[[], Iterable[dict[str, str]]]
) -> Iterator[tuple[str, dict[str, str]]]:
    every = [each for each, choice in variants.items() if choice == "*"]
    for chosen in expand() if every else [dict(variants)]:
        yield "_".join([name, *(chosen[each] for each in every)]), chosen


def _every_variant(job: Job, assets: Assets, faults: list[Fault]) -> tuple[Job, dict[str, str]]:
    """Return the job with a look for each variant, and the key in the job file of each look."""
    looks: list[JobLook] = []
    places: dict[str, str] = {}
    taken: set[str] = set()
    for index, given in enumerate(job.look):
        place = f"look[{index}]"
        with collected(job, place, faults):
            for name, chosen in _variants(given, assets):
                if name.casefold() in taken:
                    what = f"two looks of the job are called '{name}'"
                    faults.append(Fault(str(job.file), place, what, "give each its own name"))
                looks.append(given.model_copy(update={"name": name, "variants": chosen}))
                places[name] = place
                taken.add(name.casefold())
    if len(looks) > MOST_COMBINATIONS and any("*" in each.variants.values() for each in job.look):
        what = f"'*' stands for variants that make {len(looks)} looks, at most {MOST_COMBINATIONS} would be right"
        faults.append(Fault(str(job.file), "look", what, "name a variant of some of the sets"))
        raise_all(faults)
    if excess := excess_frames(len(looks), len(job.rigs), job.turntable):
        raise FaultsError([*faults, Fault(str(job.file), "turntable", excess, SEVERAL_JOBS)])
    return job.model_copy(update={"look": tuple(looks)}), places


def _variants(look: JobLook, assets: Assets) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield name and variants of each look that a look of the job stands for."""
    if look.material is not None:
        yield from each_variant(look.name, look.material, look.prim, look.variants)
    else:
        yield from _named(look.name, look.variants, lambda: assets.looks(look))


def _materials(job: Job, look: JobLook, place: str, notes: list[str], faults: list[Fault]) -> list[Look]:
    """Return the looks of each `assign` of a look, and last that of its `material`; grey where one has a fault."""
    made: list[Look] = []
    given: tuple[JobAssign | JobLook, ...] = (*look.assign, look)
    for number, each in enumerate(given):
        if each.material is None:
            continue
        key, name = (place, look.name) if each is look else (f"{place}.assign[{number}]", None)
        made.append(NEUTRAL)
        with collected(job, key, faults):
            found = read_any_look(each.material, each.prim, each.variants, name)
            made[-1] = found.look
            notes += lost_notes(found.lost)
    return made
