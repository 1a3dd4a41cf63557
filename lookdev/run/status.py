"""The status of a job that any number of runs render: frames that are done, rendering or failed, and stalled runs.

A run records its plan and its failed frames in the output's state folder. The rest of the status is read from the
frames and the claims on disk, so that no process has to run to answer.
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

_PLAN, _FAILED = "plan.json", "failed"
_MAX_PLAN_BYTES = 1 << 28  # bytes of a plan
_MAX_LISTED_FAILURES = 10  # in the text


@dataclass(frozen=True)
class FailedFrame:
    """A frame whose last try failed in a run on a host; `log` is the file with the details there, or ""."""

    name: str
    reason: str
    host: str
    log: str


@dataclass(frozen=True)
class ActiveRun:
    """A run that has not ended by itself: its frames and its state.

    `silent` are the seconds since its last heartbeat, by the clock of the file system. `state` is ``working``,
    ``stalled`` without a heartbeat for a lease, or ``dead`` where its process is known to have ended.
    """

    run: RunInfo
    state: str
    silent: float
    frames: tuple[str, ...]


@dataclass(frozen=True)
class Status:
    """The state of a job's frames in its output folder.

    `frame_seconds` is the mean time of the frames that are done, None before the first. `seconds` is the time left,
    None where no run works.
    """

    output: Path
    job: str
    total: int
    done: int
    waiting: int
    rendering: int
    failed: tuple[FailedFrame, ...]
    runs: tuple[ActiveRun, ...]
    frame_seconds: float | None
    seconds: float | None


def record_plan(run: Run, job: Path, plan: Plan) -> None:
    """Write the plan of a run to the state folder, unless the folder has it; raises OSError."""
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
    """Write the reason of a failed frame to the state folder, and return its record."""
    failed = FailedFrame(name, reason, run.info.host, str(log or ""))
    with suppress(OSError):
        write_file(run.state / _FAILED / f"{claim_key(name)}.json", json.dumps(asdict(failed)))
    return failed


def remove_failures(state: Path) -> None:
    """Remove the failures from a state folder; all frames of the output are done."""
    shutil.rmtree(state / _FAILED, ignore_errors=True)


def read_status(output: Path) -> Status:
    """Return the state of the job of an output folder; raises OutputError where no run has recorded its plan."""
    state = output / STATE_FOLDER
    plan = _read_plan(state / _PLAN)
    if not plan:
        raise OutputError(f"{output}: no run of 'lookdev render' has recorded a plan there; is it the output of a job?")
    left: dict[str, tuple[str, float]] = {}
    times: dict[str, list[float]] = {}
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
    now = _file_system_time(state)
    for run in Runs(state).all():
        silent = now - (state / "runs" / run.id).stat().st_mtime
        activity = "dead" if run.has_ended else "stalled" if silent > lease_seconds() else "working"
        yield ActiveRun(run, activity, silent, tuple(frames.get(run.id, ())))


def _file_system_time(folder: Path) -> float:
    """Return the time of the file system's clock, or this machine's where no file can be written."""
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
    """Return an estimate of the time left; None where no frame is being rendered.

    A frame takes the mean time of its scene's frames. In a scene without frames it takes its estimated cost times the
    mean ratio of time to cost in the other scenes.
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
    return name.rpartition("/")[0]


def _read_failures(state: Path) -> Iterator[FailedFrame]:
    for file in sorted((state / _FAILED).glob("*.json")):
        with suppress(TypeError):
            yield FailedFrame(**read_json_object(file))


def _read_plan(file: Path) -> dict[str, Any]:
    plan = read_json_object(file, _MAX_PLAN_BYTES)
    return plan if plan.keys() >= {"plan", "job", "frames"} else {}
