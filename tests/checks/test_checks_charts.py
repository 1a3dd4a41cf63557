"""Readings of reference props: right frames pass, a wrong exposure and wrong colours are reported."""

from dataclasses import replace

import numpy as np
import pytest

from lookdev.checks.charts import charts_doubts, charts_header, check_charts
from lookdev.light import load_environment, prepare_light
from lookdev.plan import make_setup
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.scene import Pose, Sampling, frame_camera
from lookdev.scene.charts.colorchecker import GREY_REFLECTANCE, PATCHES, patch_colors
from lookdev.scene.charts.props import Strip, props_camera, props_scene

SIZE = (160, 120)
STRIP = Strip("bottom", 0.4, SIZE)


@pytest.fixture(scope="module")
def task() -> FrameTask:
    light = prepare_light(load_environment(builtin="white"))
    camera = props_camera(frame_camera((0.0, 0.0, 0.0), 1.0, SIZE), (0.0, 0.0, 0.0))
    scene = props_scene(STRIP, camera, [light])
    setup = make_setup("charts", "white", scene, Sampling(samples=8))
    return replace(frame_task(setup.task, Pose(0.0, 0.0), "charts"), exposure=1.0)


def frame(task: FrameTask, gain: float = 1.0, noise: float = 0.0, colors: np.ndarray | None = None) -> WorkerFrame:
    """Return a frame under white light as a renderer would return it, without exposure, times `gain`."""
    rng = np.random.default_rng(5)
    picture = np.zeros((SIZE[1], SIZE[0], 3))
    radiances = dict(zip(PATCHES, patch_colors() if colors is None else colors, strict=True)) | {
        "grey ball": GREY_REFLECTANCE
    }
    for name, box in STRIP.measured_boxes.items():
        rows = slice(int(box.top) - 1, int(box.top + box.height) + 2)
        picture[rows, int(box.left) - 1 : int(box.left + box.width) + 2] = radiances[name]
    halves = [(gain * picture * (1.0 + noise * rng.standard_normal(picture.shape))).astype(np.float32) for _ in "ab"]
    return WorkerFrame(*halves, np.ones(SIZE[::-1], np.float32), 8, 0.1, 0.0, blender="fake", memory=0)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.3])
def test_a_right_frame_has_no_doubt(task: FrameTask, noise: float) -> None:
    readings = check_charts(task, STRIP, frame(task, noise=noise))
    assert [reading.name for reading in readings] == ["grey ball", *PATCHES]
    assert list(charts_doubts(readings)) == []
    assert "charts.doubt" not in charts_header(readings)
    if not noise:
        # The noise of the reference, and the facets of its ball.
        assert max(abs(reading.deviation) for reading in readings) < 2e-3


@pytest.mark.parametrize("stops", [0.01, -0.5, 1.0])
def test_a_wrong_exposure_is_reported_with_its_stops(task: FrameTask, stops: float) -> None:
    readings = check_charts(task, STRIP, frame(task, gain=2.0**stops))
    (doubt,) = charts_doubts(readings)
    assert f"all are {stops:+.2f} stops off: the exposure is wrong" in doubt
    assert charts_header(readings)["charts.doubt"] == doubt


def test_a_wrong_colour_space_is_reported(task: FrameTask) -> None:
    linear = patch_colors()
    encoded = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
    to_acescg = np.array([[0.6131, 0.3395, 0.0474], [0.0702, 0.9164, 0.0134], [0.0206, 0.1096, 0.8698]])
    for wrong in (encoded, linear @ to_acescg.T):
        (doubt,) = charts_doubts(check_charts(task, STRIP, frame(task, noise=0.02, colors=wrong)))
        assert " more" in doubt
        assert "the exposure is wrong" not in doubt


def test_one_wrong_patch_is_named(task: FrameTask) -> None:
    colors = patch_colors()
    colors[7] *= 1.05
    (doubt,) = charts_doubts(check_charts(task, STRIP, frame(task, colors=colors)))
    assert doubt == "the reference props do not show what their light predicts: purplish blue +5 %"
