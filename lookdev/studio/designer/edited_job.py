"""The job with its edits: its text, its scenes, and the assignment of looks to parts.

An asset that is opened without a job gets a new job, which is not on disk until it is saved.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from lookdev.build.assets import AssetReader, ComposedAsset
from lookdev.build.assign import Assignment, assignments_of_parts
from lookdev.build.faults import Findings
from lookdev.build.scenes import JobScenes, build_scenes
from lookdev.errors import LookdevError, nearest_hint
from lookdev.job import Job, parse_job
from lookdev.job.edit import AssignedMaterial, assign_material, assign_to_rest, unassign
from lookdev.job.keys import MATERIAL_SUFFIXES
from lookdev.job.parts import JobAssign, JobLook
from lookdev.job.schema import JobIbl, JobRig
from lookdev.light import BUILTIN_LIGHTS
from lookdev.material.library import find_preset, library_folders
from lookdev.material.library.edit import new_look
from lookdev.safe_text import decode
from lookdev.scene.parts import asset_parts
from lookdev.shipped import BUILTIN_RIGS

_LOOK = re.compile(r"look\[(\d+)\]")
_FILE_NAME = re.compile(r"\w[\w -]{0,100}\.usd[ac]?")
_HIGHEST = 2  # a path is relative to the job's folder if it goes up this number of folders at most
_MOST_READ = 1 << 20  # bytes of a file that are searched for a material
_BINARY = b"PXR-USDC"


@dataclass(frozen=True, eq=False)
class Read:
    """The job in a content of its file, and its scenes; both include a shipped light, if the page shows one."""

    job: Job
    scenes: JobScenes


class EditedJob:
    """The job of a Designer: its file, its original `content`, and the jobs and assignments in edited contents."""

    def __init__(self, file: Path, content: bytes) -> None:
        self.file = file
        self.content = content
        self._assets: tuple[Any, AssetReader] | None = None
        self._read_cached = lru_cache(8)(self._read_content)
        self._assignments_of = lru_cache(64)(self._find_assignments)
        self._paths_of_slots = lru_cache(16)(_find_paths)

    def read(self, files: Mapping[Path, bytes], light: str = "") -> Read:
        """Return the job and its scenes; `light` adds one of `shipped_lights` to the lights of the job.

        Raises JobError or FaultsError with all faults, and TextError if the content is not text.
        """
        return self._read_cached(files.get(self.file, self.content), light)

    def _read_content(self, content: bytes, light: str) -> Read:
        job = parse_job(decode(content, self.file), self.file)
        if light and (table := shipped_lights(job).get(light)):
            update = {"ibl": (*job.ibl, table)} if isinstance(table, JobIbl) else {"rig": (*job.rig, table)}
            job = job.model_copy(update=update)
        if self._assets is None or self._assets[0] != job.asset:
            self._assets = job.asset, AssetReader(job.asset)
        return Read(job, build_scenes(job, reader=self._assets[1]))

    def _look(self, read_job: Read, name: str) -> tuple[JobLook, ComposedAsset]:
        look = next(look for look in read_job.scenes.job.look if look.name == name)
        assert self._assets is not None, "a job that was read has an asset"
        return look, self._assets[1].read(look)

    def _find_assignments(self, read_job: Read, name: str) -> Mapping[str, Assignment]:
        return assignments_of_parts(*self._look(read_job, name), "", Findings(read_job.job))

    def variants(self, read_job: Read, scene_key: tuple[str, str], slot: str) -> dict[str, str]:
        """Return the variants that the job chooses for the material of a slot."""
        look, _ = self._look(read_job, scene_key[0])
        assignments = self._assignments_of(read_job, scene_key[0])
        paths = self._paths_of_slots(read_job, scene_key).get(slot, ())
        assignment = next((assignments[path] for path in paths if path in assignments), None)
        if assignment is None:
            return {} if look.material is not None else dict(look.variants)
        return dict(look.variants if assignment.assign is None else look.assign[assignment.assign].variants)

    def describe_assignments(self, read_job: Read, scene_key: tuple[str, str]) -> dict[str, Any]:
        """Return the assignment of each slot of a scene, and the paths and collections for new ones, for the page."""
        look, composed = self._look(read_job, scene_key[0])
        assignments, paths = self._assignments_of(read_job, scene_key[0]), self._paths_of_slots(read_job, scene_key)
        slots = {}
        for slot in read_job.scenes.scenes[scene_key].asset.slots:
            part_paths = paths.get(slot.path, [])
            assignment = next((assignments[path] for path in part_paths if path in assignments), None)
            table: JobLook | JobAssign | None = None
            if assignment is not None:
                table = look if assignment.assign is None else look.assign[assignment.assign]
            slots[slot.path] = {
                "paths": part_paths,
                "by": "asset" if assignment is None else "look" if assignment.assign is None else "assign",
                "pattern": "" if assignment is None else assignment.pattern,
                "material": self._stated_path(table.material) if table is not None and table.material else "",
                "variants": dict(table.variants) if table is not None else {},
            }
        return {
            "file": str(self.file),
            "locked": "" if _look_number(read_job, scene_key[0]) is not None else _WEDGE_LOCKED,
            "worn": slots,
            "paths": list(composed.paths),
            "collections": {key: sorted(members) for key, members in composed.collections.items() if members},
        }

    def list_materials(self, read_job: Read) -> dict[str, Any]:
        """Return the materials of the job, and files of looks beside the job, its materials and the library."""
        rows = [
            {
                "material": self._stated_path(table.material),
                "prim": table.prim,
                "variants": {name: choice for name, choice in table.variants.items() if choice != "*"},
            }
            for table in _tables(read_job.job)
            if table.material is not None
        ]
        job_files = {(self.file.parent / row["material"]).resolve() for row in rows}  # type: ignore[operator]
        files = (file for folder in self._folders(read_job) for file in _look_files(folder))
        other_files = [self._stated_path(file) for file in dict.fromkeys(files) if file.resolve() not in job_files]
        return {"job": [row for n, row in enumerate(rows) if row not in rows[:n]], "files": other_files}

    def assign_look(self, read_job: Read, name: str, content: bytes, body: Mapping[str, Any]) -> tuple[str, bytes]:
        """Return a label, and the content of the job in which a look is assigned to parts, or unassigned.

        The look is assigned to ``prims``, or, if they are empty, to all parts without an assignment. Raises
        LookdevError if the request is not valid, or the job does not allow the edit.
        """
        look, text = _look_number(read_job, name), decode(content, self.file)
        if look is None:
            raise LookdevError(_WEDGE_LOCKED)
        match body:
            case {"part": str(part), "take": True}:
                assignment = self._assignment(read_job, name, part)
                if assignment.assign is None:
                    raise LookdevError(f"nothing is assigned to {part}")
                return f"unassign the look of {assignment.pattern}", unassign(text, look, [assignment.pattern]).encode()
            case {"part": str(part), "prims": list(prims), "material": str(material)} if _are_names(prims):
                variants = body.get("variants", {})
                if not isinstance(variants, dict) or not _are_names([*variants, *variants.values()]):
                    raise LookdevError("the variants of a material are names and choices")
                prim = body.get("prim")
                material_table = AssignedMaterial(
                    self._readable_path(read_job, material), prim if isinstance(prim, str) and prim else None, variants
                )
                targets = ", ".join(prims) if prims else "all other parts"
                label = f"assign {Path(material_table.material).stem} to {targets}"
                if not prims:
                    return label, assign_to_rest(text, look, material_table).encode()
                return label, assign_material(
                    text, look, prims, material_table, self._assignment(read_job, name, part).assign
                ).encode()
        raise LookdevError("an assignment has a part, prims and a material; or a part, and 'take', true")

    def create_look(self, preset: str, name: str) -> Path:
        """Write a new look, whose base is a preset, beside the job; return its file."""
        if not _FILE_NAME.fullmatch(name):
            raise LookdevError(f"'{name}' is not a file name for a look; {preset}.usda would be right")
        file = self.file.with_name(name)
        new_look(file, find_preset(Path(preset).stem))
        return file

    def _assignment(self, read_job: Read, name: str, part: str) -> Assignment:
        assignments = self._assignments_of(read_job, name)
        _, composed = self._look(read_job, name)
        if part not in composed.paths:
            raise LookdevError(f"{part} is not a part of the asset ({nearest_hint(part, list(composed.paths))})")
        return assignments.get(part, Assignment())

    def _folders(self, read_job: Read) -> list[Path]:
        job_folders = [table.material.parent for table in _tables(read_job.job) if table.material]
        return list(dict.fromkeys([self.file.parent, *job_folders, *(folder.parent for folder in library_folders())]))

    def _readable_path(self, read_job: Read, material: str) -> str:
        """Return the path of a material as the job states it; raise LookdevError if the page may not read it."""
        file = Path(os.path.normpath(self.file.parent / material))
        roots = [Path.cwd(), *self._folders(read_job), *library_folders()]
        if not any(file.resolve().is_relative_to(root.resolve()) for root in roots):
            below = ", ".join(map(str, dict.fromkeys(roots)))
            raise LookdevError(f"{file}: this page reads looks below {below} alone; copy it there")
        return self._stated_path(file)

    def _stated_path(self, file: Path | None) -> str:
        """Return a path as a job states it."""
        return stated_path(file, self.file.parent) if file is not None else ""


_WEDGE_LOCKED = "this look is one of a wedge: choose the look that it varies"


def stated_path(file: Path, folder: Path) -> str:
    """Return the path of a file as a job in a folder states it: relative, unless the file is far away."""
    relative = Path(os.path.relpath(file, folder))
    return file.as_posix() if relative.parts.count("..") > _HIGHEST else relative.as_posix()


def shipped_lights(job: Job) -> dict[str, JobIbl | JobRig]:
    """Return the shipped domes and rigs that a job lacks, by names that are free in the job."""
    taken = {table.name.casefold() for table in job.rigs}
    present = {table.builtin for table in job.rigs}
    lights: list[JobIbl | JobRig] = [JobIbl(name=name, builtin=name) for name in BUILTIN_LIGHTS if name not in present]
    lights += [JobRig(name=name, builtin=name) for name in BUILTIN_RIGS if name not in present]
    by_name = {light.name if light.name not in taken else f"{light.name}_shipped": light for light in lights}
    return {name: light.model_copy(update={"name": name}) for name, light in by_name.items() if name not in taken}


def _tables(job: Job) -> list[JobLook | JobAssign]:
    """Return the tables of a job that can have a material."""
    tables: list[JobLook | JobAssign] = []
    for look in job.look:
        tables += [*look.assign, look]
    return tables


def _look_number(read_job: Read, name: str) -> int | None:
    """Return the number of a look in the job's file, or None if a wedge made the look."""
    match = _LOOK.fullmatch(read_job.scenes.look_keys[name])
    return int(match[1]) if match else None


def _find_paths(read_job: Read, scene_key: tuple[str, str]) -> dict[str, list[str]]:
    """Return the paths of the parts of each slot of a scene, by the slot's path."""
    paths: dict[str, list[str]] = {}
    for parts in asset_parts(read_job.scenes.scenes[scene_key].asset).values():
        for part in parts:
            paths.setdefault(part.slot.path, []).append(part.path)
    return paths


def _look_files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder whose beginning has a material and no geometry."""
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        if file.suffix.lower() not in MATERIAL_SUFFIXES or file.name.startswith(".") or not file.is_file():
            continue
        try:
            with file.open("rb") as stream:
                start = stream.read(_MOST_READ)
        except OSError:
            continue
        is_look = b"def Material" in start and b"def Mesh" not in start and b"def Xform" not in start
        if is_look or file.suffix.lower() in (".mtlx", ".usdz") or start.startswith(_BINARY):
            yield file


def _are_names(values: Sequence[object]) -> bool:
    return all(isinstance(value, str) and value for value in values)
