"""Checks the reference props in rendered frames: the grey ball and the patches of the colour chart.

Each rendered frame of props is checked, and doubts are reported. A reading is the mean of the frame over a square of
whole pixels inside a prop. Its prediction is the published reflectance of the prop times the radiance of a white
surface in the same square. The float64 reference computes this radiance under the lights and the exposure of the job.
The prediction is therefore independent of the colours, the light and the exposure in the renderer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from lookdev.arrays import Floats
from lookdev.material import Layer, Look
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import frame_pixels
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.scene.charts.colorchecker import GREY_REFLECTANCE, PATCHES, patch_colors
from lookdev.scene.charts.props import Box, Strip, asset_of_props, crop_camera
from lookdev.space import to_space

_WHITE = Look("white", (Layer("White", "lambert", {"reflectance": (1.0, 1.0, 1.0)}),))
_SCRAMBLES = 16  # the number of independent sets of samples of a prediction
_SAMPLES = 2048, 256
"""The samples of each set: the first number is for lights that are all infinitely far, the second for other lights.

With lights that are infinitely far, the radiance of a white surface is predicted at one patch, and is the same at all
patches. With other lights, it is predicted at each patch, with fewer samples.
"""

_FALSE_ALARM_PROBABILITY = 1e-3
"""The probability that a frame has any reading that is reported because of noise alone.

The noise has Student's distribution."""

SYSTEMATIC = 1e-3
"""The relative error that both halves of a frame may share: twice the error of a dome's points (docs/accuracy.md)."""

_MAX_LISTED = 4  # the most readings that a message lists


@dataclass(frozen=True)
class Reading:
    """A reading of a square in a frame of props.

    `measured` and `predicted` are the means over the square. `error` is the standard error of their difference. The
    arrays have the shape (3,), the channels.
    """

    name: str
    measured: Floats
    predicted: Floats
    error: Floats
    freedom: float  # degrees of freedom of the error

    @property
    def deviation(self) -> float:
        """The difference divided by the prediction, in the channel that determines `excess`."""
        return float(self._relative[self._channel])

    @property
    def excess(self) -> float:
        """The largest ratio, over the channels, of the difference to its limit; a reading above 1 is reported.

        The limit is the difference that noise and the error `SYSTEMATIC` can cause.
        """
        return float(self._ratios[self._channel])

    @property
    def _relative(self) -> Floats:
        """The differences relative to the predictions, (3,)."""
        return np.asarray((self.measured - self.predicted) / np.maximum(self.predicted, 1e-30))

    @property
    def _ratios(self) -> Floats:
        """The ratios of the differences to their limits, (3,)."""
        explained = _quantile(self.freedom) * self.error + SYSTEMATIC * self.predicted
        return np.asarray(np.abs(self.measured - self.predicted) / np.maximum(explained, 1e-30))

    @property
    def _channel(self) -> int:
        return int(self._ratios.argmax())


@cache
def _quantile(freedom: float) -> float:
    """Return the limit of a difference in standard errors, for all channels of all readings of a frame together."""
    from scipy.stats import t as student

    return float(student.isf(0.5 * _FALSE_ALARM_PROBABILITY / (3 * (1 + len(PATCHES))), freedom))


def check_charts(task: FrameTask, strip: Strip, rendered: WorkerFrame) -> tuple[Reading, ...]:
    """Return the readings of a rendered frame of props, in the order of `Strip.measured_boxes`.

    `strip` has the positions of the props. A channel with reflectance 0, like the red of cyan, is not compared.
    """
    halves = [np.asarray(half, np.float64) * 2.0**task.exposure for half in (rendered.a, rendered.b)]
    colors = {"grey ball": np.full(3, GREY_REFLECTANCE)} | dict(
        zip(PATCHES, to_space(patch_colors(), task.scene.space), strict=True)
    )
    squares = {name: _inner_square(box) for name, box in strip.measured_boxes.items()}
    light = _predict_white(task, strip, squares)
    readings = []
    for name, square in squares.items():
        left, top, side = square
        a, b = (half[top : top + side, left : left + side] for half in halves)
        count = a[..., 0].size
        # The pixels of a frame are independent, and so are the halves of each pixel.
        measured, noise = 0.5 * (a + b).mean(axis=(0, 1)), (0.5 * (a - b)) ** 2
        variance = noise.sum(axis=(0, 1)) / count**2
        white, error = light[name]
        predicted = colors[name] * white
        prediction_variance = (colors[name] * error) ** 2
        # The smaller number of degrees of freedom is a lower bound of the number by Welch and Satterthwaite.
        freedom = float(min(count, _SCRAMBLES - 1))
        readings.append(Reading(name, measured, predicted, np.sqrt(variance + prediction_variance), freedom))
    return tuple(readings)


def charts_doubts(readings: Sequence[Reading]) -> Iterator[str]:
    """Yield messages about readings with an excess above 1, each as a sentence without the frame's name."""
    off = sorted((reading for reading in readings if reading.excess > 1.0), key=lambda reading: -reading.excess)
    if not off:
        return
    names = ", ".join(f"{reading.name} {_format_deviation(reading)}" for reading in off[:_MAX_LISTED])
    more = f" and {len(off) - _MAX_LISTED} more" if len(off) > _MAX_LISTED else ""
    ratios = [1.0 + reading.deviation for reading in off]
    has_common_ratio = len(off) == len(readings) and max(ratios) < 1.02 * min(ratios) and ratios[0] > 0.0
    cause = f"; all are {math.log2(ratios[0]):+.2f} stops off: the exposure is wrong" if has_common_ratio else ""
    yield f"the reference props do not show what their light predicts: {names}{more}{cause}"


def charts_header(readings: Sequence[Reading]) -> Mapping[str, str]:
    """Return entries for the header of a frame of props: the worst reading, its excess, and the first doubt if any."""
    worst = max(readings, key=lambda reading: reading.excess)
    header = {"charts.worst": f"{worst.name} {100.0 * worst.deviation:+.3f} %", "charts.excess": repr(worst.excess)}
    doubts = list(charts_doubts(readings))
    return header | ({"charts.doubt": doubts[0]} if doubts else {})


def _format_deviation(reading: Reading) -> str:
    """Return the deviation as text, in percent, or as a factor if it is 100 % or more."""
    deviation = reading.deviation
    return f"x {1.0 + deviation:.2g}" if abs(deviation) >= 1.0 else f"{100.0 * deviation:+.2g} %"


_Square = tuple[int, int, int]
"""A square of whole pixels of a frame: its first column and row, and its side."""


def _inner_square(box: Box) -> _Square:
    """Return the largest square of whole pixels in a box, from its upper left corner."""
    left, top = math.ceil(box.left - 1e-9), math.ceil(box.top - 1e-9)
    right, bottom = math.floor(box.left + box.width + 1e-9), math.floor(box.top + box.height + 1e-9)
    return left, top, min(right - left, bottom - top)


def _predict_white(task: FrameTask, strip: Strip, squares: Mapping[str, _Square]) -> dict[str, tuple[Floats, Floats]]:
    """Predict the radiance (3,) of a white surface in the place of each prop, with its standard error (3,).

    The keys are the names of the props. The radiance includes the exposure of the frame.
    """
    scene, gain = task.scene, 2.0**task.exposure
    lights = scene.lights_of_shader(scene.slot_shaders[-1])
    is_far = all(light.is_infinitely_far for light in lights)
    pixel, samples = np.zeros((1, 2), np.int64), _SAMPLES[not is_far]
    first = next(iter(PATCHES))
    predictions: dict[str, tuple[Floats, Floats]] = {}
    for prop, names in (("grey", ["grey ball"]), ("chart", [first] if is_far else list(PATCHES))):
        surface = MeshScene(asset_of_props(strip, scene.camera, [prop]), [_WHITE])
        for number, name in enumerate(names):
            left, top, side = squares[name]
            camera = crop_camera(scene.camera, scene.resolution, Box(left, top, side, side))
            estimate = frame_pixels(
                surface, lights, camera, task.pose, (1, 1), pixel, samples=samples, scrambles=_SCRAMBLES, seed=number
            )
            predictions[name] = gain * estimate.value[0], gain * estimate.error[0]
    return dict.fromkeys(PATCHES, predictions[first]) | predictions
