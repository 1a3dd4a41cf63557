"""`lookdev check`: every check of a job or of a single look, one finding after another."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lookdev.asset.store import read_asset
from lookdev.batch.prepare import Prepared, make_scene, prepare_job
from lookdev.brdf import PARAMETERS
from lookdev.checks.albedo import ANGLES, Halves, Render, check_albedo
from lookdev.checks.finding import Finding
from lookdev.checks.gap import check_gap
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.checks.points import check_points
from lookdev.checks.stability import stress
from lookdev.codegen import ShaderSource
from lookdev.errors import LookdevError, nearest_hint
from lookdev.job.schema import Backend
from lookdev.material import Look
from lookdev.reference.render import frame_pixels
from lookdev.render.task import FrameTask, SceneTask
from lookdev.render.worker import renderer

Alter = Callable[[str], str]
Image = NDArray[np.float32]
DepthName = Literal["quick", "default", "full"]


@dataclass(frozen=True)
class Depth:
    """How much is compared.

    `cases` of the points; `places` where a varying look is taken for its albedo, at `angles`; `pixels` of a frame of at
    most `side` squared pixels, `samples` of each of its renders, `reference` samples of each of the reference's sets;
    `converged` samples for FLIP, or 0.
    """

    cases: int
    places: int
    angles: tuple[float, ...]
    pixels: int
    side: int
    samples: int
    reference: int
    converged: int


DEPTHS: dict[DepthName, Depth] = {
    "quick": Depth(10_000, 1, ANGLES[::2], 40, 64, 16, 128, 0),
    "default": Depth(40_000, 3, ANGLES, 100, 128, 32, 256, 0),
    "full": Depth(100_000, 8, tuple(np.linspace(0.0, 85.0, 18).tolist()), 400, 512, 64, 1024, 1024),
}

# Each is two halves.
_RENDERS = 4
_LOOK_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_JOB = """output = "out"
[asset]
builtin = "shaderball"
[[ibl]]
name = "city"
builtin = "city"
[[turntable]]
kind = "element"
frames = 8
[render]
resolution = [512, 512]
[[look]]
name = {name}
material = {material}
variants = {{ {variants} }}
"""


def check_file(
    file: Path | None,
    *,
    only: Sequence[str] = (),
    depth: DepthName = "default",
    seed: int = 0,
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
    backend: Backend | None = None,
    alter: Alter = lambda osl: osl,
) -> Iterator[Finding]:
    """Check every look of a job, or one look.

    Parameters
    ----------
    file
        A job (.toml), or a USD file with a look, which is then seen on the shaderball under ``city``. None, for
        ``"stability"`` alone, means every model.
    only
        Names of `CHECKS`; none means `USUAL`.
    depth
        A name of `DEPTHS`.
    seed
        Chooses cases, places, pixels and samples.
    prim, variants
        Of a look's file: its material, and the variant of each set.
    backend
        Of a look's file: what renders it, ``"exact"`` where it is None. A job says so itself.
    alter
        Is given the text of every shader and returns the one to run: how a test plants a fault.

    Raises
    ------
    LookdevError
        A check of that name does not exist, there is no file where there must be one, or a backend beside a job.
    FaultsError
        The job, or the look, is wrong.
    RenderError, WorkerError
        Cycles failed.
    """
    for name in only:
        if name not in CHECKS:
            raise LookdevError(f"there is no check '{name}' ({nearest_hint(name, list(CHECKS))})")
    names = [name for name in CHECKS if name in (only or USUAL)]
    if file is None and names != ["stability"]:
        raise LookdevError("there is nothing to check; a job or a look is needed, but for the stability of the models")
    prepared = _prepared(file, prim, variants or {}, backend) if file else None
    with renderer() as render:
        subject = _Subject(prepared, render, depth, seed, alter)
        for name in names:
            yield from CHECKS[name](subject)


def _prepared(file: Path, prim: str | None, variants: Mapping[str, str], backend: Backend | None) -> Prepared:
    if file.suffix.lower() not in _LOOK_SUFFIXES:
        if backend is not None:
            raise LookdevError(f"{file}: a job says itself what renders it: 'backend' in its table [render]")
        return prepare_job(file)
    text = _JOB.format(
        name=json.dumps(
            "".join(character if character.isascii() and character.isalnum() else "_" for character in file.stem)
        ),
        material=json.dumps(str(file.resolve()), ensure_ascii=False),
        variants=", ".join(f"{json.dumps(name)} = {json.dumps(choice)}" for name, choice in variants.items()),
    )
    if prim is not None:
        text += f"prim = {json.dumps(prim)}\n"
    with tempfile.TemporaryDirectory(prefix="lookdev-check-") as folder:
        job = Path(folder, "check.toml")
        job.write_text(text, encoding="utf-8")
        return prepare_job(job, backend)


@dataclass(frozen=True)
class _Subject:
    """What is checked, and how much."""

    prepared: Prepared | None
    render: Render
    depth: DepthName
    seed: int
    alter: Alter

    @property
    def backend(self) -> Backend:
        return self.prepared.job.render.backend if self.prepared else "exact"

    def looks(self) -> list[Look]:
        """Return each look that the asset wears once."""
        seen: list[Look] = []
        for look in chain.from_iterable(self.prepared.looks.values() if self.prepared else ()):
            if look not in seen:
                seen.append(look)
        return seen


def _check_points(subject: _Subject) -> Iterator[Finding]:
    for look in subject.looks():
        if subject.backend != "exact":
            why = f"backend {subject.backend}: only OSL can be asked for values at points"
            yield Finding("points", look.name, True, "", skipped=why)
            continue
        yield check_points(look, count=DEPTHS[subject.depth].cases, seed=subject.seed, alter=subject.alter)


def _check_albedo(subject: _Subject) -> Iterator[Finding]:
    depth = DEPTHS[subject.depth]
    for look in subject.looks():
        yield check_albedo(
            look,
            subject.render,
            points=depth.places,
            angles=depth.angles,
            seed=subject.seed,
            backend=subject.backend,
            alter=subject.alter,
        )


def _check_images(subject: _Subject) -> Iterator[Finding]:
    """Check one frame, at a random pose, of each look under each light."""
    assert subject.prepared is not None, "only the stability of models goes without a file"
    rng = np.random.default_rng(subject.seed)
    tasks: dict[tuple[str, str], list[FrameTask]] = {}
    for frame in subject.prepared.plan.frames:
        tasks.setdefault((frame.task.labels["look"], frame.task.labels["ibl"]), []).append(frame.task)
    for (look, ibl), poses in tasks.items():
        task = poses[int(rng.integers(len(poses)))]
        yield _check_image(subject, f"{look}, {ibl}", task, subject.prepared.looks[look])


def _check_image(subject: _Subject, name: str, task: FrameTask, looks: Sequence[Look]) -> Finding:
    depth, scene = DEPTHS[subject.depth], task.scene
    shrink = min(1.0, depth.side / max(scene.resolution))
    width, height = (max(1, round(shrink * pixels)) for pixels in scene.resolution)
    shaders = tuple(
        replace(shader, osl=subject.alter(shader.osl)) if isinstance(shader, ShaderSource) else shader
        for shader in scene.shaders
    )
    small = replace(scene, resolution=(width, height), shaders=shaders)

    def render(number: int, samples: int, small: SceneTask = small) -> Halves:
        # Seeds far from those of the job's own frames and of each other; the shader takes less than 2^18.
        sampling = replace(scene.sampling, samples=samples, error=None, seed=(subject.seed * 8 + number) % (1 << 18))
        return subject.render(replace(task, scene=replace(small, sampling=sampling), digest=f"{name} {number}"))

    frames = [render(number, depth.samples) for number in range(_RENDERS)]
    alpha = np.mean([frame.alpha for frame in frames], axis=0)
    if subject.backend == "nodes":
        asset = read_asset(scene.asset_file)
        exact = make_scene(asset, scene.asset_file, looks, scene.light, scene.camera, (width, height), scene.sampling)
        wanted = [render(_RENDERS + number, depth.samples, exact) for number in range(_RENDERS)]
        return check_gap(name, _halves(wanted), _halves(frames), alpha)
    pixels = choose_pixels(alpha, depth.pixels, subject.seed)
    reference = frame_pixels(
        read_asset(scene.asset_file),
        looks,
        scene.light,
        scene.camera,
        task.pose,
        (width, height),
        pixels,
        bounces=scene.sampling.bounces,
        samples=depth.reference,
        seed=subject.seed,
    )
    converged = None
    if depth.converged:
        whole = render(_RENDERS, depth.converged)
        converged = (whole.a + whole.b) / 2.0
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    return check_frame(name, halves, alpha, _RENDERS * depth.samples, pixels, reference, converged)


def _halves(frames: Sequence[Halves]) -> tuple[Image, Image]:
    return np.mean([frame.a for frame in frames], axis=0), np.mean([frame.b for frame in frames], axis=0)


def _check_stability(subject: _Subject) -> Iterator[Finding]:
    subjects: list[str | Look] = list(subject.looks()) if subject.prepared else list(PARAMETERS)
    yield from stress(subjects, subject.render, seed=subject.seed, depth=subject.depth)


CHECKS: dict[str, Callable[[_Subject], Iterator[Finding]]] = {
    "points": _check_points,
    "albedo": _check_albedo,
    "image": _check_images,
    "stability": _check_stability,
}
"""Every check by its name, in the order in which they run."""

USUAL = ("points", "albedo", "image")
"""Those that run unless others are asked for: stability takes minutes, and is mostly a matter of the models."""
