"""The job as it is edited: its text, the scenes that are read of it, and what its parts wear.

An asset that is opened without a job has one that is not on disk yet.
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
from lookdev.build.scenes import JobScenes, job_scenes
from lookdev.errors import LookdevError, nearest_hint
from lookdev.job import Job, parse_job
from lookdev.job.edit import Wear, assign, unassign, wear_all
from lookdev.job.keys import MATERIAL_SUFFIXES
from lookdev.job.parts import JobAssign, JobLook
from lookdev.job.schema import JobIbl, JobRig
from lookdev.light import BUILTIN_LIGHTS
from lookdev.light.builtin_rigs import BUILTIN_RIGS
from lookdev.material.library import find_preset, library_folders
from lookdev.material.library.edit import new_look
from lookdev.scene.dress import asset_parts
from lookdev.text import decoded

_LOOK = re.compile(r"look\[(\d+)\]")
_FILE_NAME = re.compile(r"\w[\w -]{0,100}\.usd[ac]?")
_HIGHEST = 2  # folders above the job's up to which a path is relative
_MOST_READ = 1 << 20  # bytes of a file in which a material is looked for
_BINARY = b"PXR-USDC"


@dataclass(frozen=True, eq=False)
class Read:
    """A job as it is read of a content, and its scenes; with a light that ships, where one is shown beside its own."""

    job: Job
    scenes: JobScenes


class Dressing:
    """The content of a job's file, by the edited contents of files; it is first as `content`."""

    def __init__(self, file: Path, content: bytes) -> None:
        self.file = file
        self.content = content
        self._assets: tuple[Any, AssetReader] | None = None
        self._read = lru_cache(8)(self._reading)
        self._covers = lru_cache(64)(self._assignments)
        self._paths = lru_cache(16)(_paths)

    def read(self, files: Mapping[Path, bytes], light: str = "") -> Read:
        """Return the job and its scenes; `light` is one of `shipped_lights`, which is shown beside the job's own.

        Raises JobError or FaultsError with all faults, TextError where it is no text.
        """
        return self._read(files.get(self.file, self.content), light)

    def _reading(self, content: bytes, light: str) -> Read:
        job = parse_job(decoded(content, self.file), self.file)
        if light and (found := shipped_lights(job).get(light)):
            more = {"ibl": (*job.ibl, found)} if isinstance(found, JobIbl) else {"rig": (*job.rig, found)}
            job = job.model_copy(update=more)
        if self._assets is None or self._assets[0] != job.asset:
            self._assets = job.asset, AssetReader(job.asset)
        return Read(job, job_scenes(job, reader=self._assets[1]))

    def _look(self, read: Read, name: str) -> tuple[JobLook, ComposedAsset]:
        look = next(each for each in read.scenes.job.look if each.name == name)
        assert self._assets is not None, "a job that was read has an asset"
        return look, self._assets[1].read(look)

    def _assignments(self, read: Read, name: str) -> Mapping[str, Assignment]:
        return assignments_of_parts(*self._look(read, name), "", Findings(read.job))

    def variants(self, read: Read, chosen: tuple[str, str], slot: str) -> dict[str, str]:
        """Return the variants in which a look of the job wears the material of a slot of a scene."""
        look, _ = self._look(read, chosen[0])
        covers = self._covers(read, chosen[0])
        cover = next((covers[path] for path in self._paths(read, chosen).get(slot, ()) if path in covers), None)
        if cover is None:
            return {} if look.material is not None else dict(look.variants)
        return dict(look.variants if cover.assign is None else look.assign[cover.assign].variants)

    def worn(self, read: Read, chosen: tuple[str, str]) -> dict[str, Any]:
        """Return what covers each slot of a scene, and with which words it can be dressed otherwise, for the page."""
        look, turned = self._look(read, chosen[0])
        covers, paths = self._covers(read, chosen[0]), self._paths(read, chosen)
        shown = {}
        for slot in read.scenes.scenes[chosen].asset.slots:
            own = paths.get(slot.path, [])
            cover = next((covers[path] for path in own if path in covers), None)
            given = None if cover is None else look if cover.assign is None else look.assign[cover.assign]
            shown[slot.path] = {
                "paths": own,
                "by": "asset" if cover is None else "look" if cover.assign is None else "assign",
                "pattern": "" if cover is None else cover.pattern,
                "material": self._stated(given.material) if given is not None and given.material else "",
                "variants": dict(given.variants) if given is not None else {},
            }
        return {
            "file": str(self.file),
            "locked": "" if _number(read, chosen[0]) is not None else _OF_A_WEDGE,
            "worn": shown,
            "paths": list(turned.paths),
            "collections": {key: sorted(members) for key, members in turned.collections.items() if members},
        }

    def wearables(self, read: Read) -> dict[str, Any]:
        """Return the materials of the job, and files with looks beside them, beside the job, and beside the library."""
        given = _given(read.job)
        rows = [
            {
                "material": self._stated(each.material),
                "prim": each.prim,
                "variants": {name: choice for name, choice in each.variants.items() if choice != "*"},
            }
            for each in given
            if each.material is not None
        ]
        known = {(self.file.parent / row["material"]).resolve() for row in rows}  # type: ignore[operator]
        files = (file for folder in self._folders(read) for file in _looks_in(folder))
        others = [self._stated(file) for file in dict.fromkeys(files) if file.resolve() not in known]
        return {"job": [row for n, row in enumerate(rows) if row not in rows[:n]], "files": others}

    def wear(self, read: Read, name: str, content: bytes, body: Mapping[str, Any]) -> tuple[str, bytes]:
        """Return label and content of the job in which parts wear what a page asks for.

        `prims` are dressed, or all to which nothing is assigned, where there are none. Raises LookdevError where the
        request is none, or the job cannot be edited so.
        """
        look, text = _number(read, name), decoded(content, self.file)
        if look is None:
            raise LookdevError(_OF_A_WEDGE)
        match body:
            case {"part": str(part), "take": True}:
                cover = self._cover(read, name, part)
                if cover.assign is None:
                    raise LookdevError(f"nothing is assigned to {part}")
                return f"take the look off {cover.pattern}", unassign(text, look, [cover.pattern]).encode()
            case {"part": str(part), "prims": list(prims), "material": str(material)} if _are_words(prims):
                variants = body.get("variants", {})
                if not isinstance(variants, dict) or not _are_words([*variants, *variants.values()]):
                    raise LookdevError("the variants of a material are names and choices")
                prim = body.get("prim")
                worn = Wear(self._allowed(read, material), prim if isinstance(prim, str) and prim else None, variants)
                on = ", ".join(prims) if prims else "all else"
                label = f"{on} wears {Path(worn.material).stem}"
                if not prims:
                    return label, wear_all(text, look, worn).encode()
                return label, assign(text, look, prims, worn, self._cover(read, name, part).assign).encode()
        raise LookdevError("what a part wears has the part, its prims, and a material; or 'take', true")

    def create(self, preset: str, name: str) -> Path:
        """Write a new look whose base is a preset beside the job, and return its file."""
        if not _FILE_NAME.fullmatch(name):
            raise LookdevError(f"'{name}' is no name of a file for a look: for instance {preset}.usda")
        file = self.file.with_name(name)
        new_look(file, find_preset(Path(preset).stem))
        return file

    def _cover(self, read: Read, name: str, part: str) -> Assignment:
        covers = self._covers(read, name)
        _, turned = self._look(read, name)
        if part not in turned.paths:
            raise LookdevError(f"{part} is no part of the asset ({nearest_hint(part, list(turned.paths))})")
        return covers.get(part, Assignment())

    def _folders(self, read: Read) -> list[Path]:
        of_job = [each.material.parent for each in _given(read.job) if each.material]
        return list(dict.fromkeys([self.file.parent, *of_job, *(each.parent for each in library_folders())]))

    def _allowed(self, read: Read, material: str) -> str:
        """Return the path of a material as the job states it; raises LookdevError where it may not be read."""
        file = Path(os.path.normpath(self.file.parent / material))
        roots = [Path.cwd(), *self._folders(read), *library_folders()]
        if not any(file.resolve().is_relative_to(root.resolve()) for root in roots):
            below = ", ".join(map(str, dict.fromkeys(roots)))
            raise LookdevError(f"{file}: this page reads looks below {below} alone; copy it there")
        return self._stated(file)

    def _stated(self, file: Path | None) -> str:
        """Return a path as a job states it."""
        return stated_path(file, self.file.parent) if file is not None else ""


_OF_A_WEDGE = "this look is one of a wedge: choose the look that it varies"


def stated_path(file: Path, folder: Path) -> str:
    """Return the path of a file for a job of a folder: relative, unless that is far away."""
    relative = Path(os.path.relpath(file, folder))
    return file.as_posix() if relative.parts.count("..") > _HIGHEST else relative.as_posix()


def shipped_lights(job: Job) -> dict[str, JobIbl | JobRig]:
    """Return the domes and rigs that ship and that a job does not have, by names that it does not have."""
    taken = {each.name.casefold() for each in job.rigs}
    had = {each.builtin for each in job.rigs}
    lights: list[JobIbl | JobRig] = [JobIbl(name=name, builtin=name) for name in BUILTIN_LIGHTS if name not in had]
    lights += [JobRig(name=name, builtin=name) for name in BUILTIN_RIGS if name not in had]
    named = {each.name if each.name not in taken else f"{each.name}_shipped": each for each in lights}
    return {name: each.model_copy(update={"name": name}) for name, each in named.items() if name not in taken}


def _given(job: Job) -> list[JobLook | JobAssign]:
    """Return the tables of a job that can have a material."""
    given: list[JobLook | JobAssign] = []
    for look in job.look:
        given += [*look.assign, look]
    return given


def _number(read: Read, name: str) -> int | None:
    """Return the number in the file of a look of the job; None for one that only a wedge has."""
    found = _LOOK.fullmatch(read.scenes.look_keys[name])
    return int(found[1]) if found else None


def _paths(read: Read, chosen: tuple[str, str]) -> dict[str, list[str]]:
    """Return the paths of the parts that each slot of a scene is shown as, by the slot's path."""
    found: dict[str, list[str]] = {}
    for parts in asset_parts(read.scenes.scenes[chosen].asset).values():
        for part in parts:
            found.setdefault(part.slot.path, []).append(part.path)
    return found


def _looks_in(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder that have a material and no geometry, as far as their text says."""
    for file in sorted(folder.iterdir()) if folder.is_dir() else ():
        if file.suffix.lower() not in MATERIAL_SUFFIXES or file.name.startswith(".") or not file.is_file():
            continue
        try:
            with file.open("rb") as stream:
                start = stream.read(_MOST_READ)
        except OSError:
            continue
        of_look = b"def Material" in start and b"def Mesh" not in start and b"def Xform" not in start
        if of_look or file.suffix.lower() in (".mtlx", ".usdz") or start.startswith(_BINARY):
            yield file


def _are_words(values: Sequence[object]) -> bool:
    return all(isinstance(each, str) and each for each in values)
