"""USD assets with one thing wrong: a property (`usd_mutations`), or a file of the composition (`usd_files`)."""

import random
import tempfile
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from asset_arrays import check_asset
from cases import Case, Reading, Shown, planned_kind
from pxr import Sdf, UsdUtils
from usd_files import FILES
from usd_mutations import ROLES, declared
from usd_pictures import asset_job, spot_shown
from usd_sound import SOUND, Sound, sound_layer

from lookdev.asset.subdivision import refine
from lookdev.asset.usd import read_usd
from lookdev.asset.usd.collections import collection_members
from lookdev.asset.usd.scene import name_file_in_errors
from lookdev.asset.usd_camera import read_camera
from lookdev.material.usd.bound import read_bound_looks
from lookdev.stage import Composition, compose

# Each change of each spot, and each file, once; then again, written in other ways.
_PLAN: tuple[tuple[Any, ...], ...] = (
    *(
        (spot.role, base, spot, mutation)
        for base, sound in SOUND.items()
        for spot in sound.spots
        for mutation in ROLES[spot.role]
    ),
    *((f"files: {name.split()[0]}", name) for name in FILES),
)
_ROOTS = {
    "sublayer": "subLayers = [{0}]\n)\n",
    "reference": ')\ndef "Root" (references = {0}</Root>) {{}}\n',
    "payload": ')\ndef "Root" (payload = {0}</Root>) {{}}\n',
    "variant": ')\ndef "Root" (variants = {{string model = "full"}}; prepend variantSets = "model") {{\n'
    'variantSet "model" = {{\n"full" (references = {0}</Root>) {{}}\n"none" {{}}\n}}\n}}\n',
}
"""The rest of a root layer, behind its metadata, that refers to another one."""
_WAYS = ("usda", "usdc", "usdz", *_ROOTS)


def make(rng: random.Random, planned: tuple[Any, ...], folder: Path) -> Case:
    """Write the files of a case."""
    if planned[0].startswith("files"):
        return _file_case(planned[1], rng, folder)
    _, base, spot, mutation = planned
    sound = SOUND[base]
    layer = sound_layer(sound)
    mutation.change(layer.GetPropertyAtPath(f"{spot.prim}.{spot.name}"), rng)
    way = rng.choice(_WAYS if sound.packs and sound.time is None else ("usda", "usdc"))
    if way == "usdz" and "asset" in mutation.name:  # what is packed must not name missing files
        way = "usdc"
    if declared(layer):
        way = "declared"
    file = written(layer, sound, way, folder)
    names = (spot.name.removeprefix("primvars:").removesuffix(":indices"),) if mutation.own else ()
    return Case(
        f"{base} {spot.prim}.{spot.name}: {mutation.name} ({way})",
        mutation.expected,
        lambda: read(file, sound),
        lambda: sound_reading(base, way),
        ("asset.", spot.prim, *names),
        ("asset.", spot.prim),
        spot_shown(base, spot, file, lambda layer, to: written(layer, sound, way, to)),
    )


def _file_case(name: str, rng: random.Random, folder: Path) -> Case:
    wrong, sound = FILES[name], SOUND["cage"]
    file = wrong.write(folder, rng) or folder / "asset.usda"

    def right(to: Path, notes: str) -> str:
        return asset_job(written(sound_layer(sound), sound, "usda", to).name, sound)

    return Case(
        name,
        wrong.expected,
        lambda: read(file, sound),
        lambda: sound_reading("cage", "usda"),
        wrong.names,
        wrong.names,
        Shown(asset_job(file.name, sound), {"sound": right}),
    )


def written(layer: Sdf.Layer, sound: Sound, way: str, folder: Path) -> Path:
    """Write an asset in one of several ways that USD composes to the same; return its file."""
    for name, content in sound.files.items():
        (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    # A value of another type has no text.
    inner = folder / ("asset" if way in ("usda", "usdc") else "part")
    inner = inner.with_suffix(".usda" if way == "usda" else ".usdc")
    layer.Export(str(inner))
    if way in ("usda", "usdc"):
        return inner
    if way == "usdz":
        file = folder / "asset.usdz"
        UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(inner)), str(file))
        return file
    if way == "declared":
        root = Sdf.Layer.CreateNew(str(folder / "asset.usda"))
        root.subLayerPaths.append(f"./{inner.name}")
        for name in ("metersPerUnit", "upAxis"):
            root.pseudoRoot.SetInfo(name, layer.pseudoRoot.GetInfo(name))
        if given := declared(layer):
            path = Sdf.Path(given[0])
            prim = Sdf.CreatePrimInLayer(root, path.GetPrimPath())
            Sdf.AttributeSpec(prim, path.name, Sdf.ValueTypeNames.Find(given[1]))
        root.Save()
        return folder / "asset.usda"
    head = '#usda 1.0\n(\n    metersPerUnit = 0.5\n    upAxis = "Y"\n    '
    (folder / "asset.usda").write_text(head + _ROOTS[way].format(f"@{inner.name}@"))
    return folder / "asset.usda"


@cache
def sound_reading(base: str, way: str) -> Reading:
    """Return what a sound asset reads as."""
    with tempfile.TemporaryDirectory() as folder:
        return read(written(sound_layer(SOUND[base]), SOUND[base], way, Path(folder)), SOUND[base])


def read(file: Path, sound: Sound) -> Reading:
    """Read an asset as a job does: geometry, cages refined, bound materials, a camera, a collection's members."""
    composed = compose(Composition(file))
    asset = read_usd(composed, sound.time)
    check_asset(asset)
    result: dict[str, object] = {"slots": asset.slots, "unit": asset.unit}
    for i, mesh in enumerate(asset.meshes):
        refined = mesh if mesh.subdivision is None else refine(mesh, 1)
        for each in fields(refined):
            result |= {f"mesh {i} {key}": value for key, value in _plain(each.name, getattr(refined, each.name))}
    for i, instance in enumerate(asset.instances):
        result[f"instance {i}"] = instance.mesh, instance.path, instance.matrix.tobytes()
    bound = read_bound_looks(composed, dict.fromkeys(slot.material for slot in asset.slots if slot.material))
    lost = [str(fault) for each in bound.values() for fault in each.losses]
    result |= {
        f"look {path}": repr(each.look).replace(str(file), "asset").replace(str(file.parent), "")
        for path, each in bound.items()
    }
    notes = [*asset.notes, *lost]
    if sound.camera is not None:
        camera = read_camera(composed.stage, sound.camera)
        result["camera"] = repr(camera)
        notes += camera.notes
    if sound.collection is not None:
        with name_file_in_errors(str(file)):
            result["members"] = collection_members(composed.stage, sound.collection, [s.path for s in asset.slots])
    return Reading(result, tuple(notes))


def _plain(name: str, value: Any) -> list[tuple[str, object]]:
    if isinstance(value, dict):
        return [(f"{name} {key}", each.tobytes()) for key, each in value.items()]
    return [(name, value.tobytes() if isinstance(value, np.ndarray) else value)]


USD_ASSETS = planned_kind("USD assets", _PLAN, make)
