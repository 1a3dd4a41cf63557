"""Reads the lights of a job, with the lights that wedges add, and places them around the asset.

A job has its lights in tables ``[[ibl]]`` and ``[[rig]]``. Both are called rigs here: an ``[[ibl]]`` is a rig of one
dome light.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from lookdev.asset import Asset
from lookdev.build.faults import Findings
from lookdev.build.wedges import Wedges, vary_rig
from lookdev.job.schema import Job, JobIbl, JobRig
from lookdev.job.wedge import WedgeInput
from lookdev.light import Light
from lookdev.light.dome.maps import load_dome
from lookdev.light.rig import LightRig, load_rig
from lookdev.shipped import rig_file


@dataclass(frozen=True)
class RigLights:
    """The lights of a rig of a job, in the colour space of the job.

    `check_exposed` raises an error if shaders cannot compute with the lights at an exposure. `rig` is None for an
    ``[[ibl]]``.
    """

    name: str
    lights: tuple[Light, ...]
    check_exposed: Callable[[float], None]
    notes: tuple[str, ...]
    rig: LightRig | None = None

    @property
    def is_fitted(self) -> bool:
        """Whether the rig fits an asset of any size: its unit of length is then the radius of the asset."""
        return self.rig is not None and self.rig.fit

    def place_around(self, asset: Asset) -> tuple[Light, ...]:
        """Return the lights, scaled and moved to an asset if the rig is fitted.

        To keep frames comparable, the caller passes the same asset for all looks of a job: the largest one.
        """
        if not self.is_fitted:
            return self.lights
        x, y, z = asset.center
        return tuple(light.rescale(asset.radius, (x, y, z)) for light in self.lights)

    def link_notes(self, parts: Collection[str]) -> Iterator[str]:
        """Yield a note for each path in a light link or shadow link that matches no part.

        A path matches the part at this path and all parts below it. `parts` has the paths of all parts.
        """
        for rig_light in self.rig.rig_lights if self.rig else ():
            emission = rig_light.light.emission
            links = (emission.light_link, emission.shadow_link)
            for path in dict.fromkeys(path for link in links if link for path, _ in link.rules):
                below = "/" if path == "/" else f"{path}/"
                if not any(part == path or part.startswith(below) for part in parts):
                    yield f"rig '{self.name}': {rig_light.path} is linked to {path}, but the asset has no such part"


def read_lights(job: Job, findings: Findings, *, sampled: bool) -> tuple[RigLights, ...]:
    """Read the rigs of a job; rigs with faults are left out.

    `sampled` states whether domes get tables with which shaders draw directions.
    """
    rigs: list[RigLights] = []
    for table in job.rigs:
        with findings.collect(job.key_of_rig(table.name)):
            rig = _read_table(job, table, sampled=sampled)
            rig.check_exposed(table.exposure)
            findings.note(*rig.notes)
            rigs.append(rig)
    return tuple(rigs)


def vary_lights(
    job: Job, wedges: Wedges, rigs: Sequence[RigLights], findings: Findings, *, sampled: bool
) -> tuple[Job, tuple[RigLights, ...], dict[str, str]]:
    """Return the job with the rigs that its wedges add, the lights of all rigs, and the key of each rig by its name.

    A key is the location in the job file. `rigs` has the lights of the job without wedges. Rigs that differ only in
    exposure and rotation share their lights.
    """
    keys = {rig.name: job.key_of_rig(rig.name) for rig in job.rigs}
    tables = {rig.name: rig for rig in job.rigs}
    lights = {rig.name: rig for rig in rigs}
    varied_lights, varied_tables = [], []
    for name, variation in wedges.rigs.items():
        keys[name] = variation.key
        table = vary_rig(tables[variation.base], name, variation, findings)
        varied_tables.append(table)
        with findings.collect(variation.key):
            if (base := lights.get(variation.base)) is None:
                continue  # the rig has faults, which are reported already
            values = {key.removeprefix("light:"): value for key, value in variation.changes if key.startswith("light:")}
            if values and isinstance(table, JobRig):
                base = _read_table(job, table, values, sampled=sampled)
            base.check_exposed(table.exposure)
            varied_lights.append(replace(base, name=name))
    ibls = (*job.ibl, *(table for table in varied_tables if isinstance(table, JobIbl)))
    job_rigs = (*job.rig, *(table for table in varied_tables if isinstance(table, JobRig)))
    return job.model_copy(update={"ibl": ibls, "rig": job_rigs}), (*rigs, *varied_lights), keys


def _read_table(
    job: Job, table: JobIbl | JobRig, values: Mapping[str, WedgeInput] | None = None, *, sampled: bool
) -> RigLights:
    """Read the lights of an ``[[ibl]]`` or ``[[rig]]``.

    For a ``[[rig]]``, `values` replace inputs of its lights. A key is a light, a dot and an input: ``"Key.intensity"``.
    """
    space = job.render.space
    if isinstance(table, JobIbl):
        dome_map = load_dome(table.file, table.builtin, sampled=sampled)
        notes = (f"ibl '{table.name}': {dome_map.repairs}",) if dome_map.repairs else ()
        return RigLights(table.name, (dome_map.dome.in_space(space),), dome_map.check_exposed, notes)
    file = table.usd if table.usd is not None else rig_file(table.builtin or "")
    rig = load_rig(file, table.prim, values, sampled=sampled)
    lights = tuple(light.in_space(space) for light in rig.lights)
    return RigLights(table.name, lights, rig.check_exposed, rig.notes, rig)
