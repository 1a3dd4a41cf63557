"""The status of a job that any number of runs render (`lookdev status`): its frames, and the runs that render them.

Everything is read from the output folder, so no run needs to answer. A run records its plan and its failed frames in
the state folder there. The frames on disk show which frames are done. The claims on disk show which are in work.
"""

from __future__ import annotations

import json
import os
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from datetime import timedelta
from pathlib import Path
from statistics import fmean
from typing import Any

from lookdev.cache import write_file
from lookdev.errors import LookdevError, OutputError
from lookdev.output.exr import read_header
from lookdev.output.frame_name import FrameName
from lookdev.output.manifest import STATE_FOLDER
from lookdev.plan import Plan
from lookdev.plan.costs import estimate_costs
from lookdev.run.runs import Run, RunInfo, Runs, claim_key, lease_seconds, read_claims
from lookdev.safe_text import align_columns, read_json_object

_PLAN, _FAILED = "plan.json", "failed"  # the file of the plan, and the folder of failed frames, in the state folder
_MAX_PLAN_BYTES = 1 << 28  # a larger file of a plan is not read
_MAX_LISTED_FAILURES = 10  # the most failures that the text lists


@dataclass(frozen=True)
class FailedFrame:
    """A frame whose last try failed."""

    name: str
    reason: str
    host: str  # the machine of the run that tried it
    log: str  # the file with the details on that machine, or ""


@dataclass(frozen=True)
class ActiveRun:
    """A run that has a file in the state folder: it still runs, or it died before it could remove the file.

    `state` is ``"dead"`` if its process is known to have ended, and ``"stalled"`` if the run had no heartbeat for the
    time of a lease (`lookdev.run.runs`). Otherwise it is ``"working"``.
    """

    run: RunInfo
    state: str
    silent: float  # seconds since its last heartbeat, by the clock of the file system
    frames: tuple[str, ...]  # the names of the frames that it has claimed and that are not done


@dataclass(frozen=True)
class Status:
    """The state of a job's frames in its output folder."""

    output: Path
    job: str  # the path of the job file
    total: int  # number of frames
    done: int  # number of frames on disk
    waiting: int  # number of frames that no run renders and that have not failed
    rendering: int  # number of frames that working runs have claimed
    failed: tuple[FailedFrame, ...]
    runs: tuple[ActiveRun, ...]
    frame_seconds: float | None  # the mean render time of the frames on disk; None before the first
    seconds: float | None  # an estimate of the time left; None if no run renders a frame


def record_plan(run: Run, job: Path, plan: Plan) -> None:
    """Write the plan of a run to the state folder, unless the folder has this plan already; raises OSError.

    The file has the digest of the plan, the path of the job, and for each frame its digest and its estimated cost.
    """
    file = run.state / _PLAN
    if _read_plan(file).get("plan") == plan.digest:
        return
    costs = estimate_costs(plan).frames
    frames = {
        str(FrameName.of(frame.task.files[0])): [frame.task.digest, cost]
        for frame, cost in zip(plan.frames, costs, strict=True)
    }
    write_file(file, json.dumps({"plan": plan.digest, "job": str(job), "frames": frames}))


def record_failure(run: Run, name: str, reason: str, log: Path | None) -> FailedFrame:
    """Write the record of a failed frame to the state folder, and return it."""
    failed = FailedFrame(name, reason, run.info.host, str(log or ""))
    with suppress(OSError):
        write_file(run.state / _FAILED / f"{claim_key(name)}.json", json.dumps(asdict(failed)))
    return failed


def remove_failures(state: Path) -> None:
    """Remove all records of failed frames from a state folder. Call this when all frames of the output are done."""
    shutil.rmtree(state / _FAILED, ignore_errors=True)


def read_status(output: Path) -> Status:
    """Read the status of the job of an output folder; raises OutputError if no run has recorded a plan there."""
    state = output / STATE_FOLDER
    plan = _read_plan(state / _PLAN)
    if not plan:
        raise OutputError(f"{output}: no run of 'lookdev render' has recorded a plan there; is it the output of a job?")
    left: dict[str, tuple[str, float]] = {}  # the digest and estimated cost of each frame that is not done, by name
    times: dict[str, list[float]] = {}  # the render times in seconds of the frames that are done, by scene
    for name, (digest, cost) in plan["frames"].items():
        header: Mapping[str, str] = {}
        with suppress(OutputError):
            header = read_header(output / f"{name}.exr", check=False)
        if header.get("digest") == digest:
            with suppress(KeyError, ValueError):
                times.setdefault(_scene_name(name), []).append(float(header["seconds"]))
        else:
            left[name] = digest, cost
    names = {claim_key(name): name for name in left}
    claimed = {run: [names[key] for key in keys if key in names] for run, keys in read_claims(state).items()}
    runs = tuple(_active_runs(state, claimed))
    rendering = {name for run in runs if run.state == "working" for name in run.frames}
    failed = tuple(frame for frame in _read_failures(state) if frame.name in left and frame.name not in rendering)
    return Status(
        output,
        plan["job"],
        len(plan["frames"]),
        len(plan["frames"]) - len(left),
        len(left) - len(rendering) - len(failed),
        len(rendering),
        failed,
        runs,
        fmean(seconds for scene in times.values() for seconds in scene) if times else None,
        _time_left(plan["frames"], {name: cost for name, (_, cost) in left.items()}, times, len(rendering)),
    )


def status_text(status: Status) -> str:
    """Return a status as lines of text."""
    percent = 100.0 * status.done / max(status.total, 1)
    lines = [
        f"{status.job}: {status.done} of {status.total} frames are done ({percent:.1f} %), {status.rendering} are "
        f"rendered now, {status.waiting} wait, {len(status.failed)} failed"
    ]
    if status.runs:
        rows = [["run", "chunk", "state", "last sign", "frame"]]
        for active in status.runs:
            more = len(active.frames) - 3
            frames = ", ".join(active.frames[:3]) + (f" and {more} more" if more > 0 else "")
            name, sign = f"{active.run.host} {active.run.process}", f"{max(active.silent, 0.0):.0f} s ago"
            rows.append([name, active.run.part or "-", active.state, sign, frames or "-"])
        lines += align_columns(rows)
    failed, more = status.failed[:_MAX_LISTED_FAILURES], len(status.failed) - _MAX_LISTED_FAILURES
    lines += [f"failed: {frame.name}: {frame.reason} ({frame.host}, log: {frame.log})" for frame in failed]
    lines += [f"and {more} more failed"] if more > 0 else []
    if status.seconds is not None:
        lines.append(f"left: {timedelta(seconds=round(status.seconds))} with {status.rendering} frames at a time")
    elif status.done < status.total:
        lines.append(f"no run is at work; 'lookdev render {status.job}' goes on")
    return "\n".join(lines)


def status_data(status: Status) -> dict[str, object]:
    """Return a status as plain data for JSON."""
    return asdict(status) | {"output": str(status.output)}


def status_metrics(status: Status) -> str:
    """Return a status in the text format of Prometheus; raises LookdevError where its client is not installed."""
    try:
        from prometheus_client import CollectorRegistry, Gauge, generate_latest
    except ImportError:
        raise LookdevError("metrics are written by prometheus-client: pip install 'lookdev[farm]'") from None

    registry = CollectorRegistry()

    def gauge(name: str, text: str, values: Mapping[str, float | None], label: str) -> None:
        """Add a metric with a number for each value of a label; an empty label means a single number."""
        metric = Gauge(f"lookdev_{name}", text, ["output", label] if label else ["output"], registry=registry)
        for state, number in values.items():
            if number is not None:
                metric.labels(str(status.output), *([state] if label else [])).set(number)

    frames = {"done": status.done, "rendering": status.rendering, "waiting": status.waiting}
    gauge("frames", "Frames of the job, by state.", frames | {"failed": len(status.failed)}, "state")
    runs = Counter(active.state for active in status.runs)
    states = {state: runs[state] for state in ("working", "stalled", "dead")}
    gauge("runs", "Runs that have not ended by themselves.", states, "state")
    gauge("frame_seconds", "Mean render time of the frames that are done.", {"": status.frame_seconds}, "")
    gauge("left_seconds", "Estimate of the time until all is rendered.", {"": status.seconds}, "")
    return str(generate_latest(registry).decode())


def _active_runs(state: Path, frames: Mapping[str, list[str]]) -> Iterator[ActiveRun]:
    """Yield the runs of a state folder; `frames` has the names of the frames that each run claims, by the run's id."""
    now = _file_system_time(state)
    for run in Runs(state).all():
        silent = now - (state / "runs" / run.id).stat().st_mtime
        activity = "dead" if run.has_ended else "stalled" if silent > lease_seconds() else "working"
        yield ActiveRun(run, activity, silent, tuple(frames.get(run.id, ())))


def _file_system_time(folder: Path) -> float:
    """Return the time by the clock of a folder's file system, or this machine's clock if no file can be written."""
    file = folder / f".time.{os.getpid()}"
    try:
        file.touch()
        now = file.stat().st_mtime
        file.unlink()
    except OSError:
        return time.time()
    return now


def _time_left(
    planned: Mapping[str, tuple[str, float]], left: Mapping[str, float], times: Mapping[str, list[float]], at_once: int
) -> float | None:
    """Return an estimate of the seconds left, or None if no frame is being rendered.

    A frame is assumed to take the mean time of the frames of its scene that are done. If no frame of the scene is done,
    it is assumed to take its estimated cost times the mean ratio of time to cost in other scenes.

    planned : the digest and estimated cost of each frame of the plan, by name; left : the estimated cost of each frame
    that is not done, by name; times : the seconds of the frames that are done, by scene; at_once : the number of frames
    that are rendered at the same time.
    """
    if not at_once:
        return None
    means = {scene: fmean(seconds) for scene, seconds in times.items()}
    ratios = [
        means[_scene_name(name)] / cost for name, (_, cost) in planned.items() if _scene_name(name) in means and cost
    ]
    ratio = fmean(ratios) if ratios else 1.0
    return sum(means.get(_scene_name(name), ratio * cost) for name, cost in left.items()) / at_once


def _scene_name(name: str) -> str:
    """Return the scene of a frame by its name: the look and the light, as look/ibl."""
    return name.rpartition("/")[0]


def _read_failures(state: Path) -> Iterator[FailedFrame]:
    """Yield the records of failed frames in a state folder."""
    for file in sorted((state / _FAILED).glob("*.json")):
        with suppress(TypeError):
            yield FailedFrame(**read_json_object(file))


def _read_plan(file: Path) -> dict[str, Any]:
    """Return the plan that `record_plan` has written, or {} if the file is missing or damaged."""
    plan = read_json_object(file, _MAX_PLAN_BYTES)
    return plan if plan.keys() >= {"plan", "job", "frames"} else {}
