"""Expansion of the looks of a job: a look with a variant ``"*"`` becomes one look for each variant of the set."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from lookdev.build.assets import AssetReader
from lookdev.build.faults import Findings
from lookdev.job.parts import JobLook
from lookdev.job.schema import SEVERAL_JOBS_HINT, Job, excess_frames_message
from lookdev.material.usd import expand_variants
from lookdev.material.variants import MAX_COMBINATIONS


def expand_material(
    name: str, file: Path, prim: str | None, variants: Mapping[str, str]
) -> Iterator[tuple[str, dict[str, str]]]:
    """Expand a material into looks, and yield the name and the variants of each look.

    A variant ``"*"`` expands to all variants of its set. The look of each variant is named ``<name>_<variant>``. Raises
    the LookError of `expand_variants`.
    """
    yield from _expand(name, variants, lambda: expand_variants(file, prim, variants))


def expand_looks(job: Job, assets: AssetReader, findings: Findings) -> tuple[Job, dict[str, str]]:
    """Return the job with expanded looks, and the key of each look in the job file, by the look's name.

    If there are too many looks or frames, raises FaultsError at once, before later steps add faults.
    """
    looks: list[JobLook] = []
    keys: dict[str, str] = {}
    taken: set[str] = set()
    for index, table in enumerate(job.look):
        key = f"look[{index}]"
        with findings.collect(key):
            for name, variants in _expand_table(table, assets):
                if name.casefold() in taken:
                    findings.add(key, f"two looks of the job are called '{name}'", "give each its own name")
                looks.append(table.model_copy(update={"name": name, "variants": variants}))
                keys[name] = key
                taken.add(name.casefold())
    if len(looks) > MAX_COMBINATIONS and any("*" in look.variants.values() for look in job.look):
        problem = f"'*' expands to variants that make {len(looks)} looks, at most {MAX_COMBINATIONS} would be right"
        findings.add("look", problem, "name a variant of some of the sets")
        findings.raise_faults()
    if excess := excess_frames_message(len(looks), len(job.rigs), job.turntable):
        findings.add("turntable", excess, SEVERAL_JOBS_HINT)
        findings.raise_faults()
    return job.model_copy(update={"look": tuple(looks)}), keys


def _expand_table(table: JobLook, assets: AssetReader) -> Iterator[tuple[str, dict[str, str]]]:
    """Expand a ``[[look]]`` of the job into looks, and yield the name and the variants of each look."""
    if table.material is not None:
        yield from expand_material(table.name, table.material, table.prim, table.variants)
    else:
        yield from _expand(table.name, table.variants, lambda: assets.variant_choices(table))


def _expand(
    name: str, variants: Mapping[str, str], expand: Callable[[], Iterable[dict[str, str]]]
) -> Iterator[tuple[str, dict[str, str]]]:
    """Expand a look into one look for each combination of variants, and yield their names and variants.

    `expand` returns all combinations of variants. It is called only if a variant is ``"*"``.
    """
    expanded = [variant_set for variant_set, variant in variants.items() if variant == "*"]
    for choice in expand() if expanded else [dict(variants)]:
        yield "_".join([name, *(choice[variant_set] for variant_set in expanded)]), choice
