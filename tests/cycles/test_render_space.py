"""Frames in ACEScg beside those in linear Rec.709."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from test_passes import CAMERA, GREY, POSE, SIZE, balls, render_task

from lookdev.light import Dome, Emission, load_environment, make_environment, prepare_light
from lookdev.material import Layer, Look
from lookdev.output.exr import frame_space, read_frame, read_header, read_rec709
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.scene import scene_task
from lookdev.rendering.task import FrameTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.run.frame_file import store_frame
from lookdev.scene import Film, Sampling, Scene
from lookdev.space import CHROMATICITIES, Space, to_rec709, to_space

pytestmark = pytest.mark.cycles

RED = Look("red", (Layer("paint", "disney", {"baseColor": (0.8, 0.02, 0.02), "specularTint": 1.0, "clearcoat": 0.5}),))
GOLD = Look(
    "gold", (Layer("m", "disney", {"metal": "gold", "metallic": 1.0, "fresnel": "conductor", "roughness": 0.4}),)
)
FILM = Look(
    "film", (Layer("m", "disney", {"metallic": 1.0, "filmThickness": 450.0, "filmIor": 1.4, "roughness": 0.4}),)
)
WHITE = load_environment(builtin="white")


def task(
    look: Look, space: Space, light: object, bounces: int = 0, samples: int = 16, others: Look | None = None
) -> FrameTask:
    looks = {"/set/ball": look, "/set/others": others or look}
    scene = Scene(balls(), looks, (light.in_space(space),), CAMERA, Film(SIZE, space))
    return frame_task(scene_task(scene, Sampling(samples=samples, bounces=bounces)), POSE, f"{look.name} {space}")


def beauty(frame: WorkerFrame) -> np.ndarray:
    return 0.5 * (frame.a + frame.b)


@pytest.mark.parametrize(("look", "others"), [(GREY, RED), (GOLD, FILM)], ids=["grey, red", "gold, film"])
def test_under_white_light_colours_agree_after_conversion(look: Look, others: Look, worker: Worker) -> None:
    light = prepare_light(WHITE)
    ours, other = (
        beauty(render_task(worker, task(look, space, light, others=others))) for space in ("rec709", "acescg")
    )
    # One reflection of white light is linear in what reflects it: only float32 differs, and both have the same samples.
    off = np.abs(to_rec709(other, "acescg") - ours)
    assert (off <= 2e-5 * (ours.max(axis=-1, keepdims=True) + 1e-3)).all()


def test_greys_agree_after_conversion_with_all_bounces(worker: Worker, light_of: Callable[[str], Dome]) -> None:
    light = replace(light_of("slopes"), emission=Emission((1.0, 0.7, 0.4)))
    ours, other = (
        render_task(worker, task(GREY, space, light, bounces=2, samples=256)) for space in ("rec709", "acescg")
    )
    a, b = beauty(ours), to_rec709(beauty(other), "acescg")
    # Directions of a light are drawn by the mean of its channels, which differs: the noise is another.
    noise = np.sqrt(sum(np.var(0.5 * (frame.a - frame.b), axis=(0, 1)) for frame in (ours, other)) / a[..., 0].size)
    assert (np.abs((a - b).mean(axis=(0, 1))) < 5.0 * noise).all()
    assert (noise < 2e-3 * a.mean(axis=(0, 1))).all(), "the test would notice one percent"


def test_what_coloured_light_and_a_coloured_surface_make_differs_as_the_products_do(worker: Worker) -> None:
    blue, red = np.array([0.1, 0.2, 1.0]), np.array([0.8, 0.05, 0.05])
    matte = Look("matte", (Layer("m", "lambert", {"reflectance": tuple(red.tolist())}),))
    light = prepare_light(make_environment("blue", np.full((8, 16, 3), blue, np.float32)))
    asked: tuple[Space, ...] = ("rec709", "acescg")
    for space in asked:
        frame = render_task(worker, task(matte, space, light, samples=64))
        middle = beauty(frame).max(axis=(0, 1))  # an unoccluded place
        np.testing.assert_allclose(middle, to_space(red, space) * to_space(blue, space), rtol=0.02)


def test_a_frame_states_its_space(worker: Worker, tmp_path: Path) -> None:
    light = prepare_light(WHITE)
    plain, other = (
        replace(task(RED, space, light), files=(tmp_path / f"{space}.exr",)) for space in ("rec709", "acescg")
    )
    for variant in (plain, other):
        frame = render_task(worker, variant)
        store_frame(variant, frame)
    with OpenEXR.File(str(other.files[0]), header_only=True) as exr:
        header = dict(exr.header())
    np.testing.assert_allclose(header["chromaticities"], CHROMATICITIES["acescg"], rtol=1e-6)
    assert header["colorInteropID"] == "lin_ap1_scene"
    assert read_header(other.files[0])["space"] == frame_space(other.files[0]) == "acescg"
    assert frame_space(plain.files[0]) == "rec709"
    assert "space" not in read_header(plain.files[0])
    (ours, _), (displayed, _), (raw, _) = (
        read_frame(plain.files[0]),
        read_rec709(other.files[0]),
        read_frame(other.files[0]),
    )
    np.testing.assert_allclose(displayed, ours, rtol=1e-3, atol=1e-4)
    assert np.abs(raw - ours).max() > 0.05
