"""The rigs of a job: their lights, and those of a fitted rig as they stand around its asset."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from lookdev.asset import Asset
from lookdev.errors import Fault
from lookdev.job.faults import collected
from lookdev.job.schema import Job, JobRig
from lookdev.light import Light
from lookdev.light.builtin_rigs import rig_file
from lookdev.light.dome.maps import load_dome
from lookdev.light.fit import fitted
from lookdev.light.rig import Rig, load_rig


@dataclass(frozen=True)
class Lit:
    """A rig of a job by its name; `fit`: its unit is the radius of the asset. Of an ``[[ibl]]``, `rig` is None."""

    name: str
    lights: tuple[Light, ...]
    rig: Rig | None = None

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
            found.append(Lit(ibl.name, (known.dome,)))
    for index, given in enumerate(job.rig):
        with collected(job, f"rig[{index}]", faults):
            rig = _rig(given)
            rig.check_exposed(given.exposure)
            notes += rig.notes
            found.append(Lit(given.name, rig.lights, rig))
    return tuple(found)


def _rig(given: JobRig) -> Rig:
    file = given.usd if given.usd is not None else rig_file(given.builtin or "")
    return load_rig(file, given.prim)
