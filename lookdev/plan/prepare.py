"""From a job file to its plan, in stages: the job, its scenes, their setups, and the plan of their frames.

A *setup* is a look under a light, with the sources that a backend renders.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from lookdev.asset import load_asset, make_asset
from lookdev.build.faults import Findings
from lookdev.build.scenes import JobScenes, build_scenes
from lookdev.build.wedges import WedgeSheet
from lookdev.cache import take_notes
from lookdev.codegen.source import ShaderSource, shared_programs
from lookdev.errors import EnvironmentMapError, LookdevError
from lookdev.job import Job, load_job
from lookdev.job.schema import JobRig
from lookdev.light import Light
from lookdev.material import Look
from lookdev.output.exr import read_header
from lookdev.plan import Charts, Plan, Setup, TurntableFrames, build_plan, make_setup
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.scene import SceneTasks
from lookdev.rendering.task import SceneTask
from lookdev.scene import Film, Scene
from lookdev.scene.charts.props import PROPS_FOLDER
from lookdev.space import REC709


@dataclass(frozen=True)
class JobSetups:
    """A job, the setup of each of its looks under each of its lights, notes for the user, and the sheets of wedges."""

    job: Job
    setups: tuple[Setup, ...]
    notes: tuple[str, ...]
    sheets: tuple[WedgeSheet, ...]
    charts: tuple[Setup, ...] = ()  # the setups of reference props, one for each light

    @property
    def turntable_frames(self) -> TurntableFrames:
        """The turntables of the job."""
        return TurntableFrames(self.job.turntable, self.job.output, self.job.camera.azimuth)


@dataclass(frozen=True)
class PlannedJob(JobSetups):
    """A job with its plan."""

    plan: Plan = field(kw_only=True)


def prepare_job(path: Path, backend: str | None = None) -> PlannedJob:
    """Read a job file and plan its frames with `plan_job`; raise JobError with the faults of the job file.

    `backend`, if given, replaces the backend of the job.
    """
    return plan_job(_replace_backend(load_job(path), backend))


def plan_job(job: Job, ahead: Callable[[SceneTask], None] | None = None) -> PlannedJob:
    """Read the files of a job and plan its frames; raise FaultsError with all faults of the files.

    `ahead` is called before the asset is read, with the scene of a flat card that has a look of the job. A worker that
    prepares this scene compiles the shader of the look while the frames are planned.
    """
    tasks = SceneTasks(job.render.backend, job.render.device)

    def prepare_card(job: Job, look: Look, lights: tuple[Light, ...]) -> None:
        if ahead is not None:
            with suppress(LookdevError):  # `make_setups` reports the same error
                # The built-in plane is marked as convex, and renders without bounces. The card is not marked as convex,
                # so that its shader has the bounces of the job.
                plane = load_asset(builtin="plane")
                card = make_asset("card", plane.meshes, plane.instances, plane.slots)
                scene = Scene.of_look(card, look, lights[0], job.render.resolution)
                scene = replace(scene, lights=lights, film=Film(job.render.resolution, job.render.space))
                ahead(tasks.task(scene, job.render.sampling))

    sampled = BACKENDS[job.render.backend].has_light_integral
    job_setups = make_setups(build_scenes(job, prepare_card, sampled=sampled), tasks)
    job = job_setups.job
    labels = {"job": str(job.file), "asset": job.asset.builtin or str(job.asset.usd)}
    charts = Charts(job_setups.charts, job.charts.strip(job.render.resolution)) if job.charts else None
    plan = build_plan(
        job_setups.setups,
        job_setups.turntable_frames,
        read_header,
        labels=labels,
        frame_suffixes=job.outputs.frame_suffixes,
        charts=charts,
    )
    plan = replace(plan, sheets=job_setups.sheets)
    return PlannedJob(job, job_setups.setups, job_setups.notes, job_setups.sheets, job_setups.charts, plan=plan)


def read_setups(path: Path, backend: str | None = None) -> JobSetups:
    """Read a job and its files, and return its setups in linear Rec.709; raise the errors of `prepare_job`.

    Wedges, reference props and a shadow catcher of the job are left out.
    """
    job = load_job(path)
    plane = job.ground if job.ground and job.ground.kind == "plane" else None
    render = job.render.model_copy(update={"space": REC709})
    job = job.model_copy(update={"wedge": (), "charts": None, "ground": plane, "render": render})
    job = _replace_backend(job, backend)
    # Without a named backend, domes get tables, because the caller may compare with a backend that draws directions.
    sampled = backend is None or BACKENDS[backend].has_light_integral
    tasks = SceneTasks(job.render.backend, job.render.device)
    return make_setups(build_scenes(job, sampled=sampled), tasks)


def _replace_backend(job: Job, backend: str | None) -> Job:
    if backend is None:
        return job
    return job.model_copy(update={"render": job.render.model_copy(update={"backend": backend})})


def make_setups(scenes: JobScenes, tasks: SceneTasks) -> JobSetups:
    """Return the setups of a job's scenes: generate their sources; raise FaultsError with the faults of all setups."""
    job, findings = scenes.job, Findings(scenes.job)
    rigs = {rig.name: rig for rig in job.rigs}
    props_sampling = replace(job.render.sampling, passes=(), denoise="off")
    # For each setup: the names of look and rig, the scene, the sampling, and the key of the job that its faults name.
    requests = [(PROPS_FOLDER, name, scene, props_sampling, "charts") for name, scene in scenes.charts.items()]
    for (look, name), scene in scenes.scenes.items():
        requests.append((look, name, scene, job.render.sampling, scenes.look_keys[look]))
    setups = []
    for look, name, scene, sampling, key in requests:
        with findings.collect(key):
            rig = rigs[name]
            try:
                setup = make_setup(look, name, scene, sampling, tasks)
            except EnvironmentMapError as error:
                file = [str(rig.usd)] if isinstance(rig, JobRig) and rig.usd else []
                where = ": ".join((scenes.rig_keys[name], *file))
                for line in error.args[0].splitlines():
                    findings.add(where, line)
                continue
            setup = replace(setup, exposure=rig.exposure, rotation=rig.rotation)
            # In every pose, props are at the same position in front of the camera.
            setups.append(replace(setup, is_rotation_invariant=True) if key == "charts" else setup)
    findings.raise_faults()
    shared = tuple(_share_programs(setups))
    count = len(scenes.charts)
    return JobSetups(job, shared[count:], (*scenes.notes, *take_notes()), scenes.sheets, shared[:count])


def _share_programs(setups: Sequence[Setup]) -> Iterator[Setup]:
    """Yield the setups; shaders with equal programs share one program afterwards, and the pictures stay the same."""
    shaders = [shader for setup in setups for shader in setup.task.shaders]
    shared = shared_programs(shader for shader in shaders if isinstance(shader, ShaderSource))
    for setup in setups:
        sources = (shared[shader] if isinstance(shader, ShaderSource) else shader for shader in setup.task.shaders)
        yield replace(setup, task=replace(setup.task, shaders=tuple(sources)))
