"""From a job to its scenes: reads its asset, looks and lights."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from lookdev.asset import Slot, load_asset
from lookdev.errors import AssetError, CodegenError, EnvironmentMapError, Fault, FaultsError, ModelError, TextureError
from lookdev.job.schema import Job, JobLook
from lookdev.light import Light, load_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.material.usd import expand_variants, has_look, read_look
from lookdev.scene import Film, Scene, frame_camera

# The look of a part to which a job gives none: the grey of a photographer's card, without gloss.
_NEUTRAL = Look("neutral", (Layer("Neutral", "disney", {"baseColor": (0.18, 0.18, 0.18), "roughness": 1.0}),))


@dataclass(frozen=True)
class JobScenes:
    """The scenes of a job, by look and light, look by look."""

    job: Job  # each variant is a separate look
    scenes: Mapping[tuple[str, str], Scene]
    places: Mapping[str, str]  # the key in the job file of each look
    notes: tuple[str, ...]  # for the user: repaired texels, parts left neutral


def job_scenes(job: Job) -> JobScenes:
    """Read the files of a job; raises FaultsError with all faults of all files."""
    notes: list[str] = []
    faults: list[Fault] = []
    job, places = _every_variant(job, faults)
    asset = None
    with collected(job, "asset", faults):
        asset = load_asset(job.asset.usd, job.asset.builtin, job.asset.prim)
    lights = _lights(job, notes, faults)
    worn = _worn(job, places, asset.slots if asset else (), notes, faults)
    raise_all(faults)
    assert asset is not None, "without an asset there is a fault"
    film, lens = Film(job.render.resolution), job.camera
    view = {"fov": lens.horizontal_fov, "elevation": lens.elevation, "margin": lens.margin}
    camera = frame_camera(asset.center, asset.radius, film.resolution, **view)
    scenes = {
        (look, ibl): Scene(asset, wears, (light,), camera, film)
        for look, wears in worn.items()
        for ibl, light in lights.items()
    }
    return JobScenes(job, scenes, places, tuple(notes))


def each_variant(
    name: str, file: Path, prim: str | None, variants: Mapping[str, str]
) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield name and variants of each look of a choice of variants; raises LookError as `expand_variants`.

    A ``"*"`` stands for every variant of its set; the look of each is named ``<name>_<variant>``.
    """
    every = [each for each, choice in variants.items() if choice == "*"]
    for chosen in expand_variants(file, prim, variants) if every else [dict(variants)]:
        yield "_".join([name, *(chosen[each] for each in every)]), chosen


@contextmanager
def collected(job: Job, where: str, faults: list[Fault]) -> Iterator[None]:
    """Add errors of a file of the job to `faults`, with the key that names the file."""
    try:
        yield
    except FaultsError as error:
        faults += error.faults
    except (AssetError, CodegenError, EnvironmentMapError, TextureError, ModelError) as error:
        faults.append(Fault(str(job.file), where, str(error)))


def raise_all(faults: Iterable[Fault]) -> None:
    """Raise a FaultsError of all faults, each once, if there are any."""
    if unique := tuple(dict.fromkeys(faults)):
        raise FaultsError(unique)


def _lights(job: Job, notes: list[str], faults: list[Fault]) -> dict[str, Light]:
    lights: dict[str, Light] = {}
    for index, ibl in enumerate(job.ibl):
        with collected(job, f"ibl[{index}]", faults):
            environment = load_environment(ibl.file, ibl.builtin)
            if environment.repairs:
                notes.append(f"ibl '{ibl.name}': {environment.repairs}")
            lights[ibl.name] = prepare_light(environment)
    return lights


def _every_variant(job: Job, faults: list[Fault]) -> tuple[Job, dict[str, str]]:
    """Return the job with a look for each variant, and the key in the job file of each look."""
    looks: list[JobLook] = []
    places: dict[str, str] = {}
    for index, given in enumerate(job.look):
        place = f"look[{index}]"
        with collected(job, place, faults):
            for name, chosen in each_variant(given.name, given.material, given.prim, given.variants):
                if any(name.casefold() == other.casefold() for other in places):
                    what = f"two looks of the job are called '{name}'"
                    faults.append(Fault(str(job.file), place, what, "give each its own name"))
                looks.append(given.model_copy(update={"name": name, "variants": chosen}))
                places[name] = place
    return job.model_copy(update={"look": tuple(looks)}), places


def _worn(
    job: Job, places: Mapping[str, str], slots: Sequence[Slot], notes: list[str], faults: list[Fault]
) -> dict[str, dict[str, Look]]:
    """Return, for each look of the job, the look of each slot of the asset."""
    worn: dict[str, dict[str, Look]] = {}
    bound: dict[str, Look] = {}
    for material in {slot.material: None for slot in slots if slot.material is not None}:
        if job.asset.usd is not None and has_look(job.asset.usd, material):
            with collected(job, "asset", faults):
                bound[material] = read_look(job.asset.usd, material, open_images=False)
    for given in job.look:
        place = places[given.name]
        with collected(job, place, faults):
            look = read_look(given.material, given.prim, given.variants, given.name, open_images=False)
            for pattern in given.parts or () if slots else ():
                if not any(fnmatchcase(slot.path, pattern) for slot in slots):
                    known = "known: " + ", ".join(slot.path for slot in slots)
                    faults.append(Fault(str(job.file), f"{place}.parts", f"'{pattern}' fits no part", known))
            worn[given.name] = dict(_wear(slots, given, look, bound, notes))
    return worn


def _wear(
    slots: Sequence[Slot], given: JobLook, look: Look, bound: Mapping[str, Look], notes: list[str]
) -> Iterator[tuple[str, Look]]:
    for slot in slots:
        own = bound.get(slot.material or "")
        if given.parts is not None and any(fnmatchcase(slot.path, pattern) for pattern in given.parts):
            yield slot.path, look
        elif own is not None:
            yield slot.path, own
        elif given.parts is None:
            yield slot.path, look
        else:
            notes.append(f"look '{given.name}': nothing covers {slot.path}; it is rendered neutral grey")
            yield slot.path, _NEUTRAL
