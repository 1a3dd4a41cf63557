"""Runs the checks of `lookdev check` on the looks of a job, on one look, or on the models.

The check "points" evaluates looks at points, "albedo" computes their directional albedos, "image" renders frames, and
"stability" tries extreme cases. Each compares Cycles with the models in float64 NumPy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats32
from lookdev.asset import load_asset
from lookdev.brdf import CONTINUOUS_MODELS
from lookdev.build.expand import expand_material
from lookdev.checks.albedo import ANGLES, check_albedo
from lookdev.checks.finding import CheckFinding
from lookdev.checks.frames import AlterShader, Halves, RenderHalves, alter_shaders, keep_shader
from lookdev.checks.images import check_frame, check_gap, choose_pixels
from lookdev.checks.points import check_points
from lookdev.checks.stability import DepthName, check_stability
from lookdev.codegen.source import ShaderSource
from lookdev.errors import LookdevError, nearest_hint
from lookdev.job import JobTurntable
from lookdev.job.keys import MATERIAL_SUFFIXES
from lookdev.light import load_environment, prepare_light
from lookdev.material import Look
from lookdev.material.usd.bound import read_any_look
from lookdev.plan import Setup, TurntableFrames, make_setup
from lookdev.plan.prepare import read_setups
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.rendering.backends import BACKENDS, Backend, job_backends
from lookdev.rendering.scene import SceneTasks, scene_task
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.rendering.worker import open_renderer
from lookdev.scene import Film, Pose, Sampling, Scene


@dataclass(frozen=True)
class CheckDepth:
    """The amount of work of each check except "stability"."""

    cases: int  # check "points": the number of points and directions at which a look is evaluated
    points: int  # check "albedo": the number of points at which a look that varies is checked
    angles: tuple[float, ...]  # check "albedo": the angles of view, degrees
    pixels: int  # check "image": the number of pixels that are compared with the reference
    side: int  # check "image": the largest number of pixels along the longer side of the frame
    samples: int  # check "image": the samples per pixel of each render
    reference: int  # check "image": the samples of each independent set of the reference
    converged: int  # check "image": the samples of the converged frame that FLIP compares with; 0 means no FLIP


DEPTHS: dict[DepthName, CheckDepth] = {
    "quick": CheckDepth(10_000, 1, ANGLES[::2], 40, 64, 16, 128, 0),
    "default": CheckDepth(40_000, 3, ANGLES, 100, 128, 32, 256, 0),
    "full": CheckDepth(100_000, 8, tuple(np.linspace(0.0, 85.0, 18).tolist()), 400, 512, 64, 1024, 1024),
}
"""The amounts of work that the option ``--depth`` selects."""

_RENDERS = 4  # renders of a frame, two independent halves each
_POSES = 8  # the most poses that are tried until the frame is not black
# Asset, light, frame and turntable for a look that is checked without a job.
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
    alter: AlterShader = keep_shader,
) -> Iterator[CheckFinding]:
    """Check every look of a job, or the looks of one file, and yield the findings.

    Parameters
    ----------
    file
        A job (.toml), or a USD file with a look, which is checked on the shaderball under ``city``. Without a file
        every model is checked, by ``"stability"`` only.
    only
        The names of the checks to run, keys of `CHECKS`. If it is empty, the `DEFAULT_CHECKS` run.
    depth
        A name of `DEPTHS`.
    seed
        Seed of cases, points, pixels and samples.
    prim, variants
        The material prim in a look's file, and its variants (variant set to variant).
    backend
        The backend that renders a look's file; ``"exact"`` by default.
    alter
        Alters the text of every shader.

    Raises
    ------
    LookdevError
        A check or the backend is unknown, the file is missing, or a backend is passed for a job.
    FaultsError
        The job or the look is wrong.
    RenderError, WorkerError
        Cycles fails.
    """
    for name in only:
        if name not in CHECKS:
            raise LookdevError(f"there is no check '{name}' ({nearest_hint(name, list(CHECKS))})")
    names = [name for name in CHECKS if name in (only or DEFAULT_CHECKS)]
    if file is None and names != ["stability"]:
        raise LookdevError("there is nothing to check; all checks but that of stability need a job or a look")
    setups, turns = (
        _read_setups(file, prim, variants or {}, backend) if file else ((), TurntableFrames((_TURNTABLE,), Path()))
    )
    with open_renderer() as render:
        subject = _CheckArguments(setups, turns, render, depth, seed, alter)
        for name in names:
            yield from CHECKS[name](subject)


def parse_check_names(text: str) -> tuple[str, ...]:
    """Return the names of checks in a comma-separated text."""
    return tuple(name for part in text.split(",") if (name := part.strip()))


def _read_setups(
    file: Path, prim: str | None, variants: Mapping[str, str], backend: str | None
) -> tuple[tuple[Setup, ...], TurntableFrames]:
    """Return the setups of a job or of a look's file, and their turntables."""
    if file.suffix.lower() not in MATERIAL_SUFFIXES:
        if backend is not None:
            raise LookdevError(f"{file}: the backend of a job is 'backend' in its table [render], not --backend")
        job_setups = read_setups(file)
        return job_setups.setups, job_setups.turntable_frames
    backends = list(job_backends())
    if backend is not None and backend not in backends:
        raise LookdevError(f"there is no backend '{backend}' ({nearest_hint(backend, backends)})")
    asset, light = load_asset(builtin=_ASSET), prepare_light(load_environment(builtin=_LIGHT))
    stem = "".join(character if character.isascii() and character.isalnum() else "_" for character in file.stem)
    setups, tasks = [], SceneTasks(backend or "exact")
    for name, selection in expand_material(stem, file, prim, variants):
        scene = Scene.of_look(asset, read_any_look(file, prim, selection, name).look, light, _RESOLUTION)
        setups.append(make_setup(name, _LIGHT, scene, Sampling(), tasks))
    return tuple(setups), TurntableFrames((_TURNTABLE,), Path())


@dataclass(frozen=True)
class _CheckArguments:
    """The arguments that all checks get: the setups to check, each a look under a light, and the options."""

    setups: tuple[Setup, ...]
    turns: TurntableFrames
    render: RenderHalves
    depth: DepthName
    seed: int
    alter: AlterShader

    @property
    def backend(self) -> Backend:
        return BACKENDS[self.setups[0].task.backend]

    def looks(self) -> list[Look]:
        """Return the distinct looks of the scenes."""
        looks: list[Look] = []
        for look in chain.from_iterable(setup.scene.looks for setup in self.setups):
            if look not in looks:
                looks.append(look)
        return looks


def _check_points(subject: _CheckArguments) -> Iterator[CheckFinding]:
    for look in subject.looks():
        if subject.backend.source is not ShaderSource:
            reason = f"backend {subject.backend.name}: only OSL can be evaluated at points"
            yield CheckFinding("points", look.name, True, "", skipped=reason)
            continue
        yield check_points(look, count=DEPTHS[subject.depth].cases, seed=subject.seed, alter=subject.alter)


def _check_albedo(subject: _CheckArguments) -> Iterator[CheckFinding]:
    depth = DEPTHS[subject.depth]
    for look in subject.looks():
        yield check_albedo(
            look,
            subject.render,
            points=depth.points,
            angles=depth.angles,
            seed=subject.seed,
            backend=subject.backend.name,
            alter=subject.alter,
        )


def _check_images(subject: _CheckArguments) -> Iterator[CheckFinding]:
    """Check one frame of each look under each light, at a random pose whose frame is not black."""
    rng = np.random.default_rng(subject.seed)
    for setup in subject.setups:
        poses = subject.turns.poses(setup)
        first = int(rng.integers(len(poses)))
        findings = (
            _check_image(subject, setup, poses[(first + n) % len(poses)]) for n in range(min(len(poses), _POSES))
        )
        reason = "no light arrives at the poses that were tried: nothing is compared"
        dark = CheckFinding("image", f"{setup.look}, {setup.ibl}", True, "", skipped=reason)
        yield next((finding for finding in findings if finding is not None), dark)


def _check_image(subject: _CheckArguments, setup: Setup, pose: Pose) -> CheckFinding | None:
    """Check a frame of a setup at a pose; return None if the frame is black.

    The frame of an exact backend is compared with the float64 reference. The frame of any other backend is compared
    with a frame of the backend ``exact``.
    """
    depth, task, name = DEPTHS[subject.depth], setup.task, f"{setup.look}, {setup.ibl}"
    shrink = min(1.0, depth.side / max(task.resolution))
    width, height = (max(1, round(shrink * pixels)) for pixels in task.resolution)
    small = replace(alter_shaders(task, subject.alter), resolution=(width, height))

    def render(number: int, samples: int, small: SceneTask = small) -> Halves:
        # Each render has another seed, below the limit 2^18 of a shader's seeds.
        seed = (subject.seed * 8 + number) % (1 << 18)
        return subject.render(frame_task(small, pose, f"{name} {number}", samples=samples, error=None, seed=seed))

    frames = [render(number, depth.samples) for number in range(_RENDERS)]
    if not any(half.any() for frame in frames for half in (frame.a, frame.b)):
        return None
    alpha = np.mean([frame.alpha for frame in frames], axis=0)
    if not subject.backend.exact:
        exact = scene_task(replace(setup.scene, film=Film((width, height))), task.sampling)
        expected = [render(_RENDERS + number, depth.samples, exact) for number in range(_RENDERS)]
        return check_gap(name, _mean_halves(expected), _mean_halves(frames), alpha)
    pixels = choose_pixels(alpha, depth.pixels, subject.seed)
    reference = frame_pixels(
        MeshScene(setup.scene.asset, setup.scene.looks, setup.scene.slot_lights, setup.scene.slot_groups),
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
        converged_frame = render(_RENDERS, depth.converged)
        converged = (converged_frame.a + converged_frame.b) / 2.0
    halves = np.stack([half for frame in frames for half in (frame.a, frame.b)])
    return check_frame(name, halves, alpha, _RENDERS * depth.samples, pixels, reference, converged)


def _mean_halves(frames: Sequence[Halves]) -> tuple[Floats32, Floats32]:
    """Return the mean of the frames' first halves, and the mean of the frames' second halves, each (H, W, 3)."""
    return np.mean([frame.a for frame in frames], axis=0), np.mean([frame.b for frame in frames], axis=0)


def _check_stability(subject: _CheckArguments) -> Iterator[CheckFinding]:
    subjects: Sequence[str | Look] = subject.looks() or list(CONTINUOUS_MODELS)
    yield from check_stability(subjects, subject.render, seed=subject.seed, depth=subject.depth)


CHECKS: dict[str, Callable[[_CheckArguments], Iterator[CheckFinding]]] = {
    "points": _check_points,
    "albedo": _check_albedo,
    "image": _check_images,
    "stability": _check_stability,
}
"""The functions of all checks by name, in the order in which they run."""

DEFAULT_CHECKS = ("points", "albedo", "image")
"""The checks that run by default. Stability takes minutes and depends mostly on the models."""
