"""Reference props rendered by Cycles, compared with published colours and the float64 reference."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import batches
import numpy as np
import pytest
from lending import lend_workers

from lookdev.checks.charts import charts_doubts, check_charts
from lookdev.light import Dome
from lookdev.light.rig import load_rig
from lookdev.output.exr import read_frame, read_header
from lookdev.plan import make_setup
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.run.events import Event, Noted
from lookdev.run.render import render_job
from lookdev.scene import Pose, Sampling, frame_camera
from lookdev.scene.charts.colorchecker import GREY_REFLECTANCE, PATCHES, patch_colors
from lookdev.scene.charts.props import Strip, props_camera, props_scene
from lookdev.shipped import rig_file

pytestmark = pytest.mark.cycles

SIZE = (192, 144)
STRIP = Strip("bottom", 0.3, SIZE)


def render_charts(worker: Worker, lights: list[object], samples: int) -> tuple[FrameTask, WorkerFrame]:
    camera = props_camera(frame_camera((0.0, 0.0, 0.0), 1.0, SIZE), (0.0, 0.0, 0.0))
    scene = props_scene(STRIP, camera, lights)  # type: ignore[arg-type]
    task = make_setup("charts", "light", scene, Sampling(samples=samples, bounces=3)).task
    worker.start()
    frame = replace(frame_task(task, Pose(0.0, 200.0), "charts"), exposure=0.5)
    return frame, worker.render(frame, lambda progress: None)


def test_patches_under_a_uniform_dome_are_as_published(worker: Worker, light_of: Callable[[str], Dome]) -> None:
    task, frame = render_charts(worker, [light_of("white")], 8)
    readings = check_charts(task, STRIP, frame)
    colors = np.concatenate([np.full((1, 3), GREY_REFLECTANCE), patch_colors()]) * 2.0**0.5
    for reading, expected in zip(readings, colors, strict=True):
        assert reading.measured == pytest.approx(expected, rel=2e-3, abs=1e-12), reading.name
        # What is measured has no noise here: float32 is left, and the noise of the prediction. A ball has facets, which
        # cut off what arrives between them and the horizon of its normal.
        exact = 5e-4 if reading.name == "grey ball" else 1e-5
        assert reading.measured == pytest.approx(expected, rel=exact, abs=1e-12), reading.name
        assert (np.abs(reading.measured - reading.predicted) <= 2e-3 * reading.predicted).all(), reading.name
        assert (np.abs(reading.predicted - expected) <= 5.0 * reading.error + exact * expected).all(), reading.name


@pytest.mark.parametrize(
    ("light", "samples"), [("slopes", 16), pytest.param("softbox_product", 32, marks=pytest.mark.proof)]
)
def test_props_agree_with_the_reference(worker: Worker, light_of, light: str, samples: int) -> None:
    if light == "slopes":
        lights: list[object] = [light_of(light)]
    else:
        lights = [source.rescale(1.0, (0.0, 0.0, 0.0)) for source in load_rig(rig_file(light)).lights]
    task, frame = render_charts(worker, lights, samples)
    readings = check_charts(task, STRIP, frame)
    assert list(charts_doubts(readings)) == []
    z = np.array(
        [(reading.measured - reading.predicted) / reading.error for reading in readings if reading.name != "cyan"]
    )
    assert np.abs(z).max() < 6.0
    # Some neighbours share a prediction, so that their z are similar.
    assert np.sqrt((z**2).mean()) < 2.0
    # Sensitive enough to tell a hundredth from noise.
    assert max(reading.error.max() / reading.predicted.max() for reading in readings) < 0.01


def run(folder: Path, more: str = "") -> list[str]:
    """Render a job, with more text; return its notes."""
    material = Path(__file__).parents[2] / "materials/classic/lambert.usda"
    job = batches.write_job(
        folder,
        more,
        asset='{ builtin = "sphere" }',
        look=f'[{{ name = "paint", material = "{material}" }}]',
        ibl='[{ name = "white", builtin = "white" }]',
        turntable='[{ kind = "element", frames = 3 }]',
        render="{ resolution = [112, 72], samples = 4 }",
        outputs='{ view = "Raw" }',
    )
    events: list[Event] = []
    assert render_job(job, report=events.append).exit_code == 0
    return [event.text for event in events if isinstance(event, Noted)]


def test_a_job_with_charts_has_the_frames_of_one_without(tmp_path: Path, monkeypatch, request) -> None:
    lend_workers(request, monkeypatch)
    assert run(tmp_path) == []
    frame = tmp_path / "out/paint/white/element.0001.exr"
    picture = frame.with_suffix(".png")
    before, without = frame.read_bytes(), picture.read_bytes()
    charts = '\n[charts]\nplace = "top"\nsize = 0.4\n'
    # The strip is thicker than the margin: the camera leaves room, and frames are rendered again.
    assert run(tmp_path, charts) == []
    assert frame.read_bytes() != before
    props = tmp_path / "out/charts/white/element.0001.exr"
    _, alpha = read_frame(frame)
    _, over = read_frame(props)
    assert not (alpha[: int(0.4 * 72)] > 0.0).any()
    assert not (over[int(0.4 * 72) + 1 :] > 0.0).any()
    assert float(read_header(props)["charts.excess"]) < 1.0
    assert picture.read_bytes() != without

    # A planted colour space: the props are made with encoded colours, and the published ones are expected.
    encoded = np.sqrt(patch_colors())
    monkeypatch.setattr("lookdev.scene.charts.props.patch_colors", lambda: encoded)
    (note,) = run(tmp_path, charts)
    assert note.startswith("charts/white/element.0001: the reference props do not show what their light predicts: ")
    assert read_header(props)["charts.doubt"] in note
    assert len(PATCHES) == 24
