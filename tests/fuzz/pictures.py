"""Small pictures of malformed inputs, and of what they may look like.

A case that is read, with or without a note, is rendered by a job in the folder of its files, and must show the picture
of one of the inputs that are right: the sound one or, where a note says what is left out, the sound one without it.
Seeds are the same, so frames of one digest show one picture, bit for bit. Where digests differ, as by the order of
meshes or by names in a shader, a last digit may change the choice of a few samples.
"""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cases import Case, Outcome

from lookdev.arrays import Floats32
from lookdev.errors import LookdevError
from lookdev.job import load_job
from lookdev.plan.prepare import plan_job
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask

CLOSE = 2e-5
"""The largest relative squared difference of equal pictures of two digests: 2 % of brightness are 4e-4."""

JOB = """output = "out"
asset = {{ {asset} }}
look = [{{ name = "shown"{look} }}]
ibl = [{{ name = "sky", {light} }}]
turntable = [{{ kind = "element", frames = 1, start = 30.0 }}]
render = {{ resolution = [20, 20], samples = 8, bounces = 1, backend = "exact" }}
outputs = {{ sheet = false, png = false }}
{more}
"""
STUDIO = 'builtin = "studio"'

"""Radiance and alpha (H, W, 4), or an array without pixels where the job is refused."""

REFUSED = np.zeros((0, 0, 4), np.float32)


@dataclass(frozen=True)
class Compared:
    """A case's picture beside those that are right: the name of one that it equals, or '', and what shows that."""

    like: str
    text: str
    shown: bool  # whether there is a picture
    same_task: bool = False  # whether even the frames' digests are equal


class Painter:
    """Renders folders of jobs in a warm worker; the pictures of right inputs once for each digest."""

    def __init__(self, render: Callable[[FrameTask], WorkerFrame]) -> None:
        self._render = render
        self._right: dict[str, Floats32] = {}

    def compared(self, case: Case, folder: Path, outcome: Outcome, backend: str = "exact") -> Compared:
        """Render a case whose files are in a folder, and what is right for its outcome."""
        shown = case.shown
        assert shown is not None
        digest, text, picture = self._picture(folder, shown.job, backend, None)
        seen = [text]
        for name, write in shown.right.items():
            if outcome.outcome == "sound" and name != "sound":
                continue
            with tempfile.TemporaryDirectory() as place:
                job = write(Path(place), outcome.text)
                other, text, right = self._picture(Path(place), job, backend, self._right)
            assert right.size or name != "sound", f"{case.title}: the sound input is refused: {text}"
            far = difference(picture, right)
            if far <= (CLOSE if digest != other else 0.0):
                return Compared(name, "", bool(picture.size), digest == other)
            seen.append(f"{name}: {far:.3g} {text}")
        return Compared("", "; ".join(seen), bool(picture.size))

    def picture(self, folder: Path, job: str) -> Floats32:
        """Return the picture of a job in a folder; `REFUSED` where it is refused."""
        return self._picture(folder, job, "exact", None)[2]

    def _picture(
        self, folder: Path, job: str, backend: str, known: dict[str, Floats32] | None
    ) -> tuple[str, str, Floats32]:
        file = folder / "picture.toml"
        file.write_text(job.replace('"exact"', f'"{backend}"'))
        try:
            task = plan_job(load_job(file)).plan.frames[0].task
        except LookdevError as error:
            return "", str(error)[:500], REFUSED
        if known is not None and task.digest in known:
            return task.digest, "", known[task.digest]
        rendered = self._render(task)
        picture = np.concatenate([(rendered.a + rendered.b) / 2.0, rendered.alpha[..., None]], axis=-1)
        if known is not None:
            known[task.digest] = picture
        return task.digest, "", picture


def difference(one: Floats32, other: Floats32) -> float:
    """Return the squared difference of two pictures over their squares; infinite where one alone is refused.

    It is the larger one of radiance and alpha.
    """
    if one.shape != other.shape:
        return float("inf")
    apart = np.square(one.astype(np.float64) - other).sum(axis=(0, 1))
    squares = (np.square(one, dtype=np.float64) + np.square(other, dtype=np.float64)).sum(axis=(0, 1)) / 2.0
    parts = [(apart[part].sum(), squares[part].sum()) for part in (slice(3), slice(3, 4))]
    return max((float(far / whole) if whole else 0.0 for far, whole in parts), default=0.0)


def job(asset: str, look: str = "", light: str = STUDIO, more: str = "") -> str:
    """Return the text of a job of a small picture."""
    return JOB.format(asset=asset, look=look and f", {look}", light=light, more=more)


def table(**keys: Any) -> str:
    """Return keys of a TOML table, without those that are None."""
    return ", ".join(f"{key} = {_toml(value)}" for key, value in keys.items() if value is not None)


def _toml(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f'"{key}" = {_toml(each)}' for key, each in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else str(value)
