"""The turntables of the Designer: the job's frames of the visible look and rig, rendered in the background.

They are rendered as by `lookdev render`, with EXR frames, PNG pictures and contact sheets; an interrupted run can be
resumed. They include unsaved edits and the page's settings of lights, so they have an output folder of their own.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from lookdev.errors import FaultsError, LookdevError, shorten
from lookdev.job import Job
from lookdev.plan import Setup, TurntableFrames, make_setup
from lookdev.rendering.scene import SceneTasks
from lookdev.run.events import Event, FrameDone, FrameFailed, FrameFound, FrameProgressed, Noted, RunStarted
from lookdev.scene import Scene

log = logging.getLogger("lookdev.studio")

FOLDER = "designer"
"""The folder of turntables, in the output of a job."""

_END_TIMEOUT = 2.0  # seconds that a run has to end when the server ends


class TurntableRuns:
    """The runs of a page, one at a time; each renders the turntables of one scene, in a thread of its own.

    A run renders the job as it is when the run starts. Methods are thread-safe.
    """

    def __init__(self, job: Callable[[], Job]) -> None:
        self._job = job
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._cancelled = threading.Event()
        self._files: list[Path] = []  # the pictures of the frames of the newest run, which need not exist yet
        self._number = 0  # the number of the newest run
        self._state: dict[str, Any] = {"state": "none"}  # the progress of the newest run

    def start(self, scene: Callable[[], Scene], look: str, rig: str) -> None:
        """Start to render the turntables of the scene of the job's `look` and `rig`.

        The thread of the run calls `scene`, which returns the scene. Raises LookdevError if a run is in progress.
        """
        with self._lock:
            if self._thread is not None and self._thread.is_alive():
                raise LookdevError("a turntable is being rendered: cancel it first")
            self._cancelled.clear()
            self._number += 1
            job = self._job()
            turntable_frames = TurntableFrames(job.turntable, job.output / FOLDER, job.camera.azimuth)
            exr = [
                file
                for turntable in turntable_frames.turntables
                for file in turntable_frames.files(look, rig, turntable)
            ]
            self._files = [file.with_suffix(".png") for file in exr]
            self._state = {
                "state": "rendering",
                "run": self._number,
                "output": str(turntable_frames.output / look / rig),
                "total": len(exr),
                "pending": len(exr),
                "done": 0,
                "frame": "",
                "samples": 0,
                "relmse": None,
                "failed": [],
                "notes": [],
            }
            # A daemon: Python does not wait for it at exit, and workers end with the process.
            self._thread = threading.Thread(
                target=self._run, args=(job, scene, look, rig, turntable_frames), daemon=True
            )
            self._thread.start()

    def cancel(self) -> None:
        """Cancel the run; finished frames stay, and the next run continues from them."""
        self._cancelled.set()

    def close(self) -> None:
        """End the run, with its worker."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(_END_TIMEOUT)

    def describe(self) -> Mapping[str, Any]:
        """Return the progress of the newest run; ``pictures`` are the numbers of the frames that have a picture."""
        with self._lock:
            state, files = dict(self._state), list(self._files)
        return {**state, "pictures": [number for number, file in enumerate(files) if file.is_file()]}

    def picture(self, run: int, number: int) -> Path | None:
        """Return the picture of a frame of the newest run, or None if there is no picture."""
        with self._lock:
            if run != self._number or not 0 <= number < len(self._files):
                return None
            file = self._files[number]
        return file if file.is_file() else None

    def _run(
        self, job: Job, scene: Callable[[], Scene], look: str, rig: str, turntable_frames: TurntableFrames
    ) -> None:
        """Render the turntables of a scene, and record the end of the run; this runs in the thread of the run."""
        # Not at the top: its imports are slow, and a page needs them only here.
        from lookdev.run.render import render_setups

        try:
            setup = _setup(job, scene(), look, rig)
            outputs = job.outputs.model_copy(update={"png": True})
            _, result = render_setups([setup], turntable_frames, outputs, job.render.background, report=self._report)
            end_state = "cancelled" if result.interrupted else "done" if not self._state["failed"] else "failed"
            self._update_state(state=end_state)
        except KeyboardInterrupt:
            self._update_state(state="cancelled")
        except FaultsError as error:
            self._update_state(state="failed", error="; ".join(str(fault) for fault in error.faults))
        except LookdevError as error:
            self._update_state(state="failed", error=str(error))
        except Exception as error:
            log.exception("a turntable failed")
            self._update_state(state="failed", error=f"{type(error).__name__}: {shorten(str(error))}")

    def _report(self, event: Event) -> None:
        """Update the progress by an event of the run, or end the run if it is cancelled."""
        if self._cancelled.is_set():
            raise KeyboardInterrupt  # as Ctrl-C ends `lookdev render`
        match event:
            case RunStarted():
                self._update_state(pending=event.pending, done=event.total - event.pending)
            case FrameProgressed():
                self._update_state(frame=event.name, samples=event.samples, relmse=event.relmse)
            case FrameDone() | FrameFound():
                self._update_state(done=self._state["done"] + 1)
            case FrameFailed():
                self._update_state(failed=[*self._state["failed"], f"{event.name}: {event.reason}"])
            case Noted():
                self._update_state(notes=[*self._state["notes"], event.text])

    def _update_state(self, **values: Any) -> None:
        """Set entries of the progress that `describe` returns."""
        with self._lock:
            self._state = {**self._state, **values}


def _setup(job: Job, scene: Scene, look: str, rig: str) -> Setup:
    """Return what `render_setups` needs to render a scene of a job."""
    render = job.render
    setup = make_setup(look, rig, scene, render.sampling, SceneTasks(render.backend, render.device))
    rig_table = next(rig_table for rig_table in job.rigs if rig_table.name == rig)
    return replace(setup, exposure=rig_table.exposure, rotation=rig_table.rotation)
