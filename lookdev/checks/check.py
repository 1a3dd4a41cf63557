"""`lookdev check`: every check of a job or of a look."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lookdev.asset import load_asset
from lookdev.brdf import CONTINUOUS
from lookdev.build.expand import expand_material
from lookdev.checks.albedo import ANGLES, check_albedo
from lookdev.checks.finding import Finding
from lookdev.checks.frames import Alter, Halves, Render, altered, unaltered
from lookdev.checks.gap import check_gap
from lookdev.checks.images import check_frame, choose_pixels
from lookdev.checks.points import check_points
from lookdev.checks.stability import stress
from lookdev.codegen import ShaderSource
from lookdev.errors import LookdevError, nearest_hint
from lookdev.job import JobTurntable
from lookdev.job.keys import MATERIAL_SUFFIXES
from lookdev.light import load_environment, prepare_light
from lookdev.material import Look
from lookdev.material.usd.bound import read_any_look
from lookdev.plan import Setup, Turns, make_setup
from lookdev.plan.prepare import read_setups
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.rendering.backends import BACKENDS, Backend, job_backends
from lookdev.rendering.scene import SceneTasks, scene_task
from lookdev.rendering.task import SceneTask, one_frame
from lookdev.rendering.worker import renderer
from lookdev.scene import Film, Pose, Sampling, Scene

Image = NDArray[np.float32]
DepthName = Literal["quick", "default", "full"]


@dataclass(frozen=True)
class Depth:
    """How much is compared."""

    cases: int  # of the check of points
    places: int  # where the albedo of a varying look is taken
    angles: tuple[float, ...]  # of the albedo
    pixels: int  # of a frame, compared with the reference
    side: int  # the most pixels of a frame's longer side
    samples: int  # of each render of a frame
    reference: int  # of each of the reference's sets
    converged: int  # samples for FLIP, or 0


DEPTHS: dict[DepthName, Depth] = {
    "quick": Depth(10_000, 1, ANGLES[::2], 40, 64, 16, 128, 0),
    "default": Depth(40_000, 3, ANGLES, 100, 128, 32, 256, 0),
    "full": Depth(100_000, 8, tuple(np.linspace(0.0, 85.0, 18).tolist()), 400, 512, 64, 1024, 1024),
}

_RENDERS = 4  # of a frame, two halves each
_POSES = 8  # that are tried until light arrives at one
# For a look without a job.
_ASSET, _LIGHT, _RESOLUTION = "shaderball", "city", (512, 512)
_TURNTABLE = JobTurntable(kind="element", frames=8)


def check_file(
    file: Path | None,
    *,
    only: Sequence[str] = (),
    depth: DepthName = "default",
    seed: int = 0,
    prim: str | None = None,
    variants: Mapping[str, str] | None = None,
    backend: str | None = None,
    alter: Alter = unaltered,
) -> Iterator[Finding]:
    """Check every look of a job, or one look.

    Parameters
    ----------
    file
        A job (.toml), or a USD file with a look, to be checked on the shaderball under ``city``. None means every
        model, for ``"stability"`` only.
    only, depth
        Names of `CHECKS`, none means `USUAL`; and of `DEPTHS`.
    seed
        Chooses cases, places, pixels and samples.
    prim, variants, backend
        Of a look's file: its material, the variant of each set, and its backend, ``"exact"`` where it is None.
    alter
        Alters the text of every shader.

    Raises
    ------
    LookdevError
        There is no such check or backend, the file is missing, or a backend is given for a job.
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
    setups, turns = _read(file, prim, variants or {}, backend) if file else ((), Turns((_TURNTABLE,), Path()))
    with renderer() as render:
        subject = _Subject(setups, turns, render, depth, seed, alter)
        for name in names:
            yield from CHECKS[name](subject)


def parse_only(text: str) -> tuple[str, ...]:
    """Return the names in a text, separated by commas."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def _read(
    file: Path, prim: str | None, variants: Mapping[str, str], backend: str | None
) -> tuple[tuple[Setup, ...], Turns]:
    """Return the setups of a job or a look, and their turntables."""
    if file.suffix.lower() not in MATERIAL_SUFFIXES:
        if backend is not None:
            raise LookdevError(f"{file}: the backend of a job is 'backend' in its table [render], not --backend")
        made = read_setups(file)
        return made.setups, made.turns
    known = list(job_backends())
    if backend is not None and backend not in known:
        raise LookdevError(f"there is no backend '{backend}' ({nearest_hint(backend, known)})")
    asset, light = load_asset(builtin=_ASSET), prepare_light(load_environment(builtin=_LIGHT))
    stem = "".join(character if character.isascii() and character.isalnum() else "_" for character in file.stem)
    setups, tasks = [], SceneTasks(backend or "exact")
    for name, chosen in expand_material(stem, file, prim, variants):
        scene = Scene.of_look(asset, read_any_look(file, prim, chosen, name).look, light, _RESOLUTION)
        setups.append(make_setup(name, _LIGHT, scene, Sampling(), tasks))
    return tuple(setups), Turns((_TURNTABLE,), Path())


@dataclass(frozen=True)
class _Subject:
    """What is checked, how, and how much."""

    setups: tuple[Setup, ...]
    turns: Turns
    render: Render
    depth: DepthName
    seed: int
    alter: Alter

    @property
    def backend(self) -> Backend:
        return BACKENDS[self.setups[0].task.backend]

    def looks(self) -> list[Look]:
        """Return each look of the scenes once."""
        seen: list[Look] = []
        for look in chain.from_iterable(setup.scene.looks for setup in self.setups):
            if look not in seen:
                seen.append(look)
        return seen


def _check_points(subject: _Subject) -> Iterator[Finding]:
    for look in subject.looks():
        if subject.backend.source is not ShaderSource:
            why = f"backend {subject.backend.name}: only OSL can be evaluated at points"
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
            backend=subject.backend.name,
            alter=subject.alter,
        )


def _check_images(subject: _Subject) -> Iterator[Finding]:
    """Check one frame, at a random pose in which light arrives, of each look under each light."""
    rng = np.random.default_rng(subject.seed)
    for setup in subject.setups:
        poses = subject.turns.poses(setup)
        first = int(rng.integers(len(poses)))
        tried = (_check_image(subject, setup, poses[(first + n) % len(poses)]) for n in range(min(len(poses), _POSES)))
        why = "no light arrives at the poses that were tried: nothing is compared"
        dark = Finding("image", f"{setup.look}, {setup.ibl}", True, "", skipped=why)
        yield next((found for found in tried if found is not None), dark)


def _check_image(subject: _Subject, setup: Setup, pose: Pose) -> Finding | None:
    """Check a frame; None where it is black."""
    depth, task, name = DEPTHS[subject.depth], setup.task, f"{setup.look}, {setup.ibl}"
    shrink = min(1.0, depth.side / max(task.resolution))
    width, height = (max(1, round(shrink * pixels)) for pixels in task.resolution)
    small = replace(altered(task, subject.alter), resolution=(width, height))

    def render(number: int, samples: int, small: SceneTask = small) -> Halves:
        # Seeds differ from those of the job's frames and of each other; a shader takes less than 2^18.
        seed = (subject.seed * 8 + number) % (1 << 18)
        return subject.render(one_frame(small, pose, f"{name} {number}", samples=samples, error=None, seed=seed))

    frames = [render(number, depth.samples) for number in range(_RENDERS)]
    if not any(half.any() for frame in frames for half in (frame.a, frame.b)):
        return None
    alpha = np.mean([frame.alpha for frame in frames], axis=0)
    if not subject.backend.exact:
        exact = scene_task(replace(setup.scene, film=Film((width, height))), task.sampling)
        expected = [render(_RENDERS + number, depth.samples, exact) for number in range(_RENDERS)]
        return check_gap(name, _halves(expected), _halves(frames), alpha)
    pixels = choose_pixels(alpha, depth.pixels, subject.seed)
    reference = frame_pixels(
        MeshScene(setup.scene.asset, setup.scene.looks, setup.scene.lit_by, setup.scene.grouped),
        task.lights,
        task.camera,
        pose,
        (width, height),
        pixels,
        bounces=task.sampling.bounces,
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
    yield from stress(subject.looks() or list(CONTINUOUS), subject.render, seed=subject.seed, depth=subject.depth)


CHECKS: dict[str, Callable[[_Subject], Iterator[Finding]]] = {
    "points": _check_points,
    "albedo": _check_albedo,
    "image": _check_images,
    "stability": _check_stability,
}
"""Every check by its name, in order of execution."""

USUAL = ("points", "albedo", "image")
"""The checks that run by default; stability takes minutes, and depends mostly on the models."""
