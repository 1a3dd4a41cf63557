"""The rigs of a job: their lights, and those of a fitted rig as they stand around its asset."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from lookdev.asset import Asset
from lookdev.build.faults import collected
from lookdev.build.wedges import Wedges, varied_rig
from lookdev.errors import Fault
from lookdev.job.schema import Job, JobIbl, JobRig
from lookdev.job.wedge import Value
from lookdev.light import Light
from lookdev.light.builtin_rigs import rig_file
from lookdev.light.dome.maps import load_dome
from lookdev.light.fit import fitted
from lookdev.light.rig import Rig, load_rig
from lookdev.light.space import in_space


@dataclass(frozen=True)
class Lit:
    """A rig of a job by its name; `fit`: its unit is the radius of the asset. Of an ``[[ibl]]``, `rig` is None."""

    name: str
    lights: tuple[Light, ...]
    rig: Rig | None = None
    check_exposed: Callable[[float], None] = lambda exposure: None

    @property
    def fit(self) -> bool:
        """Whether it waits for the size of the asset."""
        return self.rig is not None and self.rig.fit

    def around(self, asset: Asset) -> tuple[Light, ...]:
        """Return the lights as they stand around an asset, the largest of a job: so looks remain comparable."""
        if not self.fit:
            return self.lights
        x, y, z = asset.center
        return tuple(fitted(light, asset.radius, (x, y, z)) for light in self.lights)

    def unlinked(self, parts: Collection[str]) -> Iterator[str]:
        """Yield a note on each path that a light is linked to, and that neither is one of the parts nor has any."""
        for each in self.rig.given if self.rig else ():
            emission = each.light.emission
            links = (emission.light_link, emission.shadow_link)
            for path in dict.fromkeys(path for link in links if link for path, _ in link.rules):
                below = "/" if path == "/" else f"{path}/"
                if not any(part == path or part.startswith(below) for part in parts):
                    yield f"rig '{self.name}': {each.path} is linked to {path}, but the asset has no such part"


def job_lights(job: Job, notes: list[str], faults: list[Fault]) -> tuple[Lit, ...]:
    """Read the lights of a job; adds to notes and to faults."""
    found: list[Lit] = []
    for index, ibl in enumerate(job.ibl):
        with collected(job, f"ibl[{index}]", faults):
            known = load_dome(ibl.file, ibl.builtin)
            known.check_exposed(ibl.exposure)
            if known.repairs:
                notes.append(f"ibl '{ibl.name}': {known.repairs}")
            lights = (in_space(known.dome, job.render.space),)
            found.append(Lit(ibl.name, lights, check_exposed=known.check_exposed))
    for index, given in enumerate(job.rig):
        with collected(job, f"rig[{index}]", faults):
            rig = _rig(given)
            rig.check_exposed(given.exposure)
            notes += rig.notes
            found.append(Lit(given.name, _lights(rig, job), rig, rig.check_exposed))
    return tuple(found)


def wedge_lights(
    job: Job, wedges: Wedges, lit: Sequence[Lit], faults: list[Fault]
) -> tuple[Job, tuple[Lit, ...], dict[str, str]]:
    """Return the job with the lights of its wedges, these lights, and the key in the job file of each light.

    `lit` are the lights of the job; what differs in exposure and rotation alone has their tables. Adds to `faults`.
    """
    places = {rig.name: job.place_of(rig.name) for rig in job.rigs}
    given = {rig.name: rig for rig in job.rigs}
    shining = {each.name: each for each in lit}
    made, tables = [], []
    for name, varied in wedges.rigs.items():
        places[name] = varied.place
        table = varied_rig(given[varied.base], name, varied, job, faults)
        tables.append(table)
        with collected(job, varied.place, faults):
            if (base := shining.get(varied.base)) is None:
                continue  # it has faults of its own
            values = {key.removeprefix("light:"): value for key, value in varied.changes if key.startswith("light:")}
            if values and isinstance(table, JobRig):
                rig = _rig(table, values)
                base = Lit(name, _lights(rig, job), rig, rig.check_exposed)
            base.check_exposed(table.exposure)
            made.append(replace(base, name=name))
    ibls = (*job.ibl, *(table for table in tables if isinstance(table, JobIbl)))
    rigs = (*job.rig, *(table for table in tables if isinstance(table, JobRig)))
    return job.model_copy(update={"ibl": ibls, "rig": rigs}), tuple(made), places


def _lights(rig: Rig, job: Job) -> tuple[Light, ...]:
    return tuple(in_space(each, job.render.space) for each in rig.lights)


def _rig(given: JobRig, values: Mapping[str, Value] | None = None) -> Rig:
    file = given.usd if given.usd is not None else rig_file(given.builtin or "")
    return load_rig(file, given.prim, values)
