"""The job that the Designer edits: its text, its scenes, and the assignment of looks to parts.

A part is a mesh or GeomSubset of the asset, at a path. A slot has the faces of one or more parts with the same look. In
a job, a look has a `material` for all parts, and a list `assign` of tables, each with a material for some parts. Where
neither covers a part, the part has the material that the asset binds.

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
from lookdev.studio.roots import is_below

_LOOK = re.compile(r"look\[(\d+)\]")  # the key of a look in a job's file, unless a wedge made the look
_FILE_NAME = re.compile(r"\w[\w -]{0,100}\.usd[ac]?")  # a valid file name of a new look
_MAX_PARENT_FOLDERS = 2  # largest number of ".." in a path that is relative to the job's folder
_MAX_READ_BYTES = 1 << 20  # bytes of a file that are searched for a material
_BINARY_USD = b"PXR-USDC"  # the first bytes of binary USD


@dataclass(frozen=True, eq=False)
class ParsedJob:
    """A job, parsed from one content of its file, and its scenes.

    If the page shows a shipped light that the file lacks, the job and the scenes have it, too.
    """

    job: Job
    scenes: JobScenes


class EditedJob:
    """The job that a Designer edits: its file, its original `content`, and caches of parsed contents."""

    def __init__(self, file: Path, content: bytes) -> None:
        self.file = file
        self.content = content
        self._assets: tuple[Any, AssetReader] | None = None  # the newest `[asset]` table, and its reader
        self._parse_cached = lru_cache(8)(self._parse_content)
        self._assignments_of = lru_cache(64)(self._find_assignments)
        self._paths_of_slots = lru_cache(16)(_find_paths)

    def parse(self, edited_contents: Mapping[Path, bytes], light: str = "") -> ParsedJob:
        """Return the job and its scenes; unless `light` is empty, the shipped light of this name is added to the job.

        `edited_contents` has the edited contents of files; if it lacks the job's file, the original content is parsed.
        Raises JobError or FaultsError with all faults, and TextError if the content is not text.
        """
        return self._parse_cached(edited_contents.get(self.file, self.content), light)

    def _parse_content(self, content: bytes, light: str) -> ParsedJob:
        """Parse a content of the job's file; add the shipped light of the name `light`, unless it is empty."""
        job = parse_job(decode(content, self.file), self.file)
        if light and (table := shipped_lights(job).get(light)):
            update = {"ibl": (*job.ibl, table)} if isinstance(table, JobIbl) else {"rig": (*job.rig, table)}
            job = job.model_copy(update=update)
        if self._assets is None or self._assets[0] != job.asset:
            self._assets = job.asset, AssetReader(job.asset)
        return ParsedJob(job, build_scenes(job, reader=self._assets[1]))

    def _look_and_asset(self, parsed_job: ParsedJob, name: str) -> tuple[JobLook, ComposedAsset]:
        """Return the job's look of this name, and the asset as composed for this look."""
        look = next(look for look in parsed_job.scenes.job.look if look.name == name)
        assert self._assets is not None, "a job that was read has an asset"
        return look, self._assets[1].read(look)

    def _find_assignments(self, parsed_job: ParsedJob, name: str) -> Mapping[str, Assignment]:
        """Return the assignments of a job's look, by the paths of the parts to which the look assigns a material."""
        return assignments_of_parts(*self._look_and_asset(parsed_job, name), "", Findings(parsed_job.job))

    def variants(self, parsed_job: ParsedJob, scene_key: tuple[str, str], slot: str) -> dict[str, str]:
        """Return the variant of each set that the job chooses for the material of a slot, which is a path."""
        look, _ = self._look_and_asset(parsed_job, scene_key[0])
        assignments = self._assignments_of(parsed_job, scene_key[0])
        paths = self._paths_of_slots(parsed_job, scene_key).get(slot, ())
        assignment = next((assignments[path] for path in paths if path in assignments), None)
        if assignment is None:
            return {} if look.material is not None else dict(look.variants)
        return dict(look.variants if assignment.assign is None else look.assign[assignment.assign].variants)

    def describe_assignments(self, parsed_job: ParsedJob, scene_key: tuple[str, str]) -> dict[str, Any]:
        """Return the assignments of a scene's look for the page.

        ``assignments`` has a record for each slot, by its path. In the record, ``paths`` are the paths of the slot's
        parts, and ``by`` is what chooses the material: an ``assign`` of the look, the ``look`` itself, or the
        ``asset``; ``pattern``, ``material`` and ``variants`` are the values in the job, or empty.

        For new assignments, the result also has the ``paths`` of all parts, and the ``collections`` of parts.
        ``locked`` is the reason why the assignments cannot be edited, or empty.
        """
        look, composed = self._look_and_asset(parsed_job, scene_key[0])
        assignments, paths = self._assignments_of(parsed_job, scene_key[0]), self._paths_of_slots(parsed_job, scene_key)
        slots = {}
        for slot in parsed_job.scenes.scenes[scene_key].asset.slots:
            part_paths = paths.get(slot.path, [])
            assignment = next((assignments[path] for path in part_paths if path in assignments), None)
            table: JobLook | JobAssign | None = None
            if assignment is not None:
                table = look if assignment.assign is None else look.assign[assignment.assign]
            slots[slot.path] = {
                "paths": part_paths,
                "by": "asset" if assignment is None else "look" if assignment.assign is None else "assign",
                "pattern": "" if assignment is None else assignment.pattern,
                "material": self._path_in_job(table.material) if table is not None and table.material else "",
                "variants": dict(table.variants) if table is not None else {},
            }
        return {
            "file": str(self.file),
            "locked": "" if _look_number(parsed_job, scene_key[0]) is not None else _WEDGE_LOCKED,
            "assignments": slots,
            "paths": list(composed.paths),
            "collections": {key: sorted(members) for key, members in composed.collections.items() if members},
        }

    def list_materials(self, parsed_job: ParsedJob) -> dict[str, Any]:
        """Return the materials that the ``job`` names, and further look ``files``.

        These files are in the folders of the job, of its materials and of the library.
        """
        rows = [
            {
                "material": self._path_in_job(table.material),
                "prim": table.prim,
                "variants": {name: choice for name, choice in table.variants.items() if choice != "*"},
            }
            for table in _tables(parsed_job.job)
            if table.material is not None
        ]
        job_files = {(self.file.parent / row["material"]).resolve() for row in rows}  # type: ignore[operator]
        files = (file for folder in self._folders(parsed_job) for file in _look_files(folder))
        other_files = [self._path_in_job(file) for file in dict.fromkeys(files) if file.resolve() not in job_files]
        return {"job": [row for n, row in enumerate(rows) if row not in rows[:n]], "files": other_files}

    def assign_look(
        self, parsed_job: ParsedJob, name: str, content: bytes, body: Mapping[str, Any]
    ) -> tuple[str, bytes]:
        """Return a label for the history, and the job's content with a material assigned to parts, or unassigned.

        `name` is the job's look that is edited, `content` is the job's present content, and `body` is the page's
        request. In the request, ``part`` is the path of the picked part, and ``prims`` are the patterns of paths to
        which ``material`` is assigned; if there are none, the material is assigned to all parts without an assignment.
        Raises LookdevError if the request is not valid, or the job does not allow the edit.
        """
        look_number, text = _look_number(parsed_job, name), decode(content, self.file)
        if look_number is None:
            raise LookdevError(_WEDGE_LOCKED)
        match body:
            case {"part": str(part), "unassign": True}:
                assignment = self._assignment(parsed_job, name, part)
                if assignment.assign is None:
                    raise LookdevError(f"nothing is assigned to {part}")
                label = f"unassign the look of {assignment.pattern}"
                return label, unassign(text, look_number, [assignment.pattern]).encode()
            case {"part": str(part), "prims": list(prims), "material": str(material)} if _are_names(prims):
                variants = body.get("variants", {})
                if not isinstance(variants, dict) or not _are_names([*variants, *variants.values()]):
                    raise LookdevError("the variants of a material are names and choices")
                prim = body["prim"] if isinstance(body.get("prim"), str) and body["prim"] else None
                material_table = AssignedMaterial(self._readable_path(parsed_job, material), prim, variants)
                targets = ", ".join(prims) if prims else "all other parts"
                label = f"assign {Path(material_table.material).stem} to {targets}"
                if not prims:
                    return label, assign_to_rest(text, look_number, material_table).encode()
                covering_assign = self._assignment(parsed_job, name, part).assign
                return label, assign_material(text, look_number, prims, material_table, covering_assign).encode()
        raise LookdevError(
            "an assignment needs 'part', 'prims' and 'material'; its removal needs 'part', and 'unassign' = true"
        )

    def create_look(self, preset: str, name: str) -> Path:
        """Write a new look, whose base is a preset, beside the job; return its file."""
        if not _FILE_NAME.fullmatch(name):
            raise LookdevError(f"'{name}' is not a file name for a look; {preset}.usda would be right")
        file = self.file.with_name(name)
        new_look(file, find_preset(Path(preset).stem))
        return file

    def _assignment(self, parsed_job: ParsedJob, name: str, part: str) -> Assignment:
        """Return the assignment that covers a part; raise LookdevError if the asset has no such part."""
        assignments = self._assignments_of(parsed_job, name)
        _, composed = self._look_and_asset(parsed_job, name)
        if part not in composed.paths:
            raise LookdevError(f"{part} is not a part of the asset ({nearest_hint(part, list(composed.paths))})")
        return assignments.get(part, Assignment())

    def _folders(self, parsed_job: ParsedJob) -> list[Path]:
        """Return the folders in which the page lists files of looks."""
        job_folders = [table.material.parent for table in _tables(parsed_job.job) if table.material]
        return list(dict.fromkeys([self.file.parent, *job_folders, *(folder.parent for folder in library_folders())]))

    def _readable_path(self, parsed_job: ParsedJob, material: str) -> str:
        """Return the path of a material as the job states it; raise LookdevError if the page may not read it."""
        file = Path(os.path.normpath(self.file.parent / material))
        roots = [Path.cwd(), *self._folders(parsed_job), *library_folders()]
        if not is_below(file, roots):
            below = ", ".join(map(str, dict.fromkeys(roots)))
            raise LookdevError(
                f"{file}: this page reads only looks in these folders: {below}; copy the file into one of them"
            )
        return self._path_in_job(file)

    def _path_in_job(self, file: Path | None) -> str:
        """Return a path as the job states it, or an empty string for None."""
        return path_in_job(file, self.file.parent) if file is not None else ""


_WEDGE_LOCKED = "this look is a variation in a wedge: select the look from which the wedge is made"


def path_in_job(file: Path, folder: Path) -> str:
    """Return the path of a file as a job in a folder states it.

    It is relative to the folder, unless it then begins with more than `_MAX_PARENT_FOLDERS` ``..``.
    """
    relative = Path(os.path.relpath(file, folder))
    return file.as_posix() if relative.parts.count("..") > _MAX_PARENT_FOLDERS else relative.as_posix()


def shipped_lights(job: Job) -> dict[str, JobIbl | JobRig]:
    """Return the shipped domes and rigs that a job lacks, by names that are free in the job."""
    taken = {table.name.casefold() for table in job.rigs}
    present = {table.builtin for table in job.rigs}
    lights: list[JobIbl | JobRig] = [JobIbl(name=name, builtin=name) for name in BUILTIN_LIGHTS if name not in present]
    lights += [JobRig(name=name, builtin=name) for name in BUILTIN_RIGS if name not in present]
    by_name = {light.name if light.name not in taken else f"{light.name}_shipped": light for light in lights}
    return {name: light.model_copy(update={"name": name}) for name, light in by_name.items() if name not in taken}


def _tables(job: Job) -> list[JobLook | JobAssign]:
    """Return the tables of a job that can have a material: its looks, each after its assignments."""
    tables: list[JobLook | JobAssign] = []
    for look in job.look:
        tables += [*look.assign, look]
    return tables


def _look_number(parsed_job: ParsedJob, name: str) -> int | None:
    """Return the number of a look in the job's file, or None if a wedge made the look."""
    match = _LOOK.fullmatch(parsed_job.scenes.look_keys[name])
    return int(match[1]) if match else None


def _find_paths(parsed_job: ParsedJob, scene_key: tuple[str, str]) -> dict[str, list[str]]:
    """Return the paths of the parts of each slot of a scene, by the slot's path."""
    paths: dict[str, list[str]] = {}
    for parts in asset_parts(parsed_job.scenes.scenes[scene_key].asset).values():
        for part in parts:
            paths.setdefault(part.slot.path, []).append(part.path)
    return paths


def _look_files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder that can be looks.

    These are all files of MaterialX, USDZ and binary USD, and USD text whose first `_MAX_READ_BYTES` define a material
    and no geometry.
    """
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        if file.suffix.lower() not in MATERIAL_SUFFIXES or file.name.startswith(".") or not file.is_file():
            continue
        try:
            with file.open("rb") as stream:
                start = stream.read(_MAX_READ_BYTES)
        except OSError:
            continue
        is_look = b"def Material" in start and b"def Mesh" not in start and b"def Xform" not in start
        if is_look or file.suffix.lower() in (".mtlx", ".usdz") or start.startswith(_BINARY_USD):
            yield file


def _are_names(values: Sequence[object]) -> bool:
    """Return whether all values are texts, and none is empty."""
    return all(isinstance(value, str) and value for value in values)
