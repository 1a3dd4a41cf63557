"""From a job to what is rendered: reads the asset, the looks and the lights, and generates the shaders."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path

from lookdev.asset import Asset, Slot, load_asset, save_asset
from lookdev.codegen import NodeSource, PrincipledSource, ShaderSource, Source
from lookdev.errors import AssetError, CodegenError, EnvironmentMapError, Fault, FaultsError, ModelError, TextureError
from lookdev.job import Job, JobLook, load_job
from lookdev.job.schema import Backend, Device
from lookdev.light import Light, load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.material.usd import expand_variants, has_look, read_look
from lookdev.output.exr import read_header
from lookdev.plan import Plan, build_plan, frame_sampling
from lookdev.plan.skips import find_skips, same_all_around
from lookdev.render.source import look_source
from lookdev.render.task import SceneTask
from lookdev.scene.camera import Camera
from lookdev.scene.framing import frame_camera
from lookdev.scene.sampling import Sampling

# What stands where a job gives a part no look: the grey of a photographer's card, without gloss.
_NEUTRAL = Look("neutral", (Layer("Neutral", "disney", {"baseColor": (0.18, 0.18, 0.18), "roughness": 1.0}),))


@dataclass(frozen=True)
class Prepared:
    """A job, its plan, and what the user should know of its files (repaired texels, parts left neutral).

    `looks` has by name what each slot of the asset wears.
    """

    job: Job
    plan: Plan
    notes: tuple[str, ...]
    looks: Mapping[str, tuple[Look, ...]]


def prepare_job(path: Path, backend: Backend | None = None) -> Prepared:
    """Read everything a job names and plan its frames, for another backend than the job's if one is given.

    Raises
    ------
    JobError
        The job file itself is wrong.
    FaultsError
        All faults of all that it names.
    """
    notes: list[str] = []
    faults: list[Fault] = []
    job, places = _every_variant(load_job(path), faults)
    if backend is not None:
        job = job.model_copy(update={"render": job.render.model_copy(update={"backend": backend})})
    asset = None
    with _collected(job, "asset", faults):
        asset = load_asset(job.asset.usd, job.asset.builtin, job.asset.prim)
    lights = _lights(job, notes, faults)
    looks = _looks(job, places, asset.slots if asset else (), notes, faults)
    _raise_all(faults)
    assert asset is not None, "without an asset there is a fault"
    asset_file = save_asset(asset)
    camera = frame_camera(
        asset.center,
        asset.radius,
        job.render.resolution,
        fov=job.camera.horizontal_fov,
        elevation=job.camera.elevation,
        margin=job.camera.margin,
    )
    sampling = frame_sampling(job.render)
    scenes: dict[tuple[str, str], SceneTask] = {}
    for place, look in zip(places, job.look, strict=True):
        with _collected(job, place, faults):
            for ibl, light in lights.items():
                scene = make_scene(
                    asset,
                    asset_file,
                    looks[look.name],
                    light,
                    camera,
                    job.render.resolution,
                    sampling,
                    job.render.backend,
                    job.render.device,
                )
                faults += _attribute_faults(asset, scene.shaders)
                scenes[look.name, ibl] = scene
    _raise_all(faults)
    around = {key for key, scene in scenes.items() if asset.revolved and same_all_around(looks[key[0]], scene.shaders)}
    plan = build_plan(job, scenes, read_header, around)
    return Prepared(job, replace(plan, skips=tuple(find_skips(job, scenes, looks, around))), tuple(notes), looks)


def make_scene(
    asset: Asset,
    asset_file: Path,
    slots: Sequence[Look],
    light: Light,
    camera: Camera,
    resolution: tuple[int, int],
    sampling: Sampling,
    backend: Backend = "exact",
    device: Device = "cpu",
) -> SceneTask:
    """Generate the sources of a scene: `slots` has the look of each of the asset's slots.

    Raises
    ------
    CodegenError, EnvironmentMapError
        The backend cannot show one of the looks, or the light.
    """
    # Slots that share a look share its shader.
    different = {id(look): look for look in slots}

    def generate(sampling: Sampling, shadows: bool) -> dict[int, ShaderSource | NodeSource]:
        return {
            key: look_source(look, backend, light, resolution, sampling, shadows=shadows)
            for key, look in different.items()
        }

    # Light that a convex asset reflects never meets it again; light that passes through meets a closed one from inside.
    chosen = replace(sampling, bounces=0) if asset.convex else sampling
    shaders = generate(chosen, shadows=not asset.convex)
    if asset.convex and not asset.sheet and any(each.transmits or each.see_through for each in shaders.values()):
        chosen = sampling
        shaders = generate(sampling, shadows=True)
    return SceneTask(asset_file, tuple(shaders[id(look)] for look in slots), light, resolution, chosen, camera, device)


@contextmanager
def _collected(job: Job, where: str, faults: list[Fault]) -> Iterator[None]:
    """Add what is wrong with a file that the job names to `faults`, with the place where it is named."""
    try:
        yield
    except FaultsError as error:
        faults += error.faults
    except (AssetError, CodegenError, EnvironmentMapError, TextureError, ModelError) as error:
        faults.append(Fault(str(job.file), where, str(error)))


def _lights(job: Job, notes: list[str], faults: list[Fault]) -> dict[str, Light]:
    lights: dict[str, Light] = {}
    for index, ibl in enumerate(job.ibl):
        with _collected(job, f"ibl[{index}]", faults):
            environment = load_environment(ibl.file, ibl.builtin)
            if environment.repairs:
                notes.append(f"ibl '{ibl.name}': {environment.repairs}")
            lights[ibl.name] = prepare_light(environment)
    return lights


def _every_variant(job: Job, faults: list[Fault]) -> tuple[Job, tuple[str, ...]]:
    """Replace a look with ``variants = { wear = "*" }`` by one for each variant, named ``<look>_<variant>``.

    Returns the job and the place of each of its looks in the file.
    """
    looks: list[JobLook] = []
    places: list[str] = []
    for index, wanted in enumerate(job.look):
        place = f"look[{index}]"
        every = [name for name, choice in wanted.variants.items() if choice == "*"]
        with _collected(job, place, faults):
            for chosen in (
                expand_variants(wanted.material, wanted.prim, wanted.variants) if every else [wanted.variants]
            ):
                name = "_".join([wanted.name, *(chosen[each] for each in every)])
                if any(name.casefold() == other.name.casefold() for other in looks):
                    what = f"two looks of the job are called '{name}'"
                    faults.append(Fault(str(job.file), place, what, "give each its own name"))
                looks.append(wanted.model_copy(update={"name": name, "variants": chosen}))
                places.append(place)
    return job.model_copy(update={"look": tuple(looks)}), tuple(places)


def _looks(
    job: Job, places: Sequence[str], slots: Sequence[Slot], notes: list[str], faults: list[Fault]
) -> dict[str, tuple[Look, ...]]:
    """Return for each look of the job what each slot of the asset wears."""
    looks: dict[str, tuple[Look, ...]] = {}
    bound: dict[str, Look] = {}
    for material in {slot.material: None for slot in slots if slot.material is not None}:
        if job.asset.usd is not None and has_look(job.asset.usd, material):
            with _collected(job, "asset", faults):
                bound[material] = read_look(job.asset.usd, material, open_images=False)
    for place, wanted in zip(places, job.look, strict=True):
        with _collected(job, place, faults):
            look = read_look(wanted.material, wanted.prim, wanted.variants, wanted.name, open_images=False)
            for pattern in wanted.parts or () if slots else ():
                if not any(fnmatchcase(slot.path, pattern) for slot in slots):
                    known = "known: " + ", ".join(slot.path for slot in slots)
                    faults.append(Fault(str(job.file), f"{place}.parts", f"'{pattern}' fits no part", known))
            looks[wanted.name] = tuple(_wear(slots, wanted, look, bound, notes))
    return looks


def _wear(
    slots: Sequence[Slot], wanted: JobLook, look: Look, bound: dict[str, Look], notes: list[str]
) -> Iterator[Look]:
    for slot in slots:
        own = bound.get(slot.material or "")
        if wanted.parts is not None and any(fnmatchcase(slot.path, pattern) for pattern in wanted.parts):
            yield look
        elif own is not None:
            yield own
        elif wanted.parts is None:
            yield look
        else:
            notes.append(f"look '{wanted.name}': nothing covers {slot.path}; it is rendered neutral grey")
            yield _NEUTRAL


def _attribute_faults(asset: Asset, shaders: Iterable[Source]) -> Iterator[Fault]:
    """Find shaders that read what a mesh does not carry; only USD primvars have a fallback."""
    for slot, shader in enumerate(shaders):
        if isinstance(shader, PrincipledSource):
            continue
        for mesh in asset.meshes:
            if not (mesh.face_slots == slot).any():
                continue
            for binding in shader.attributes:
                place = f"{asset.slots[slot].path}, look '{shader.name}'"
                if binding.kind == "uv":
                    if binding.attribute not in mesh.uvs:
                        known = ", ".join(mesh.uvs)
                        yield Fault(asset.name, place, f"no UV set '{binding.attribute}'", f"it has: {known}")
                elif binding.attribute in mesh.primvars:
                    is_color = mesh.primvars[binding.attribute].ndim == 2
                    if is_color != (binding.kind == "color"):
                        found = "colour" if is_color else "float"
                        what = f"primvar '{binding.attribute}' is a {found}, the look reads a {binding.kind}"
                        yield Fault(asset.name, place, what)


def _raise_all(faults: Iterable[Fault]) -> None:
    unique = tuple(dict.fromkeys(faults))
    if unique:
        raise FaultsError(unique)
