"""Surfaces of the Explorer, without a server: reading, values, and copies."""

import shlex
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from lookdev.brdf import CONTINUOUS_MODELS, evaluate
from lookdev.brdf.angles import spherical_direction
from lookdev.brdf.measured.files import write_anisotropic
from lookdev.errors import LookdevError
from lookdev.material.usd import read_look
from lookdev.plotting import KINDS, PlotOptions, read_subject
from lookdev.studio.explorer.run import add_file_to_roots
from lookdev.studio.explorer.surfaces import Surfaces, accelerate, look_from_layers
from lookdev.studio.explorer.usd import usd_text
from lookdev.studio.packets import encode_packet
from lookdev.studio.roots import Roots

MATERIALS = Path(__file__).parents[2] / "materials"
WO, WI = spherical_direction(np.array([0.3, 0.9])), spherical_direction(np.array([0.5, 0.2]), np.array([1.0, 2.5]))


@pytest.fixture
def surfaces(tmp_path: Path, roots: Path) -> Surfaces:
    uploads = tmp_path / "uploads"
    uploads.mkdir()
    roots_of_page = Roots(uploads)
    roots_of_page.add(roots)
    roots_of_page.add(MATERIALS)
    return Surfaces(roots_of_page, MATERIALS / "presets")


def test_words_are_described(surfaces: Surfaces) -> None:
    for words, label, base, stated in (
        ("disney:roughness=.3,baseColor=.8/.2/.1", "", "disney", {"roughness": 0.3, "baseColor": [0.8, 0.2, 0.1]}),
        ("mine=red_plastic:roughness=.1", "mine", "red_plastic", {"roughness": 0.1}),
        ("scans/satin.binary", "", "measured", {"file": "scans/satin.binary"}),
        ("materials/car_paint.usda@.2,.3", "", "materials/car_paint.usda@.2,.3", {}),
    ):
        description = surfaces.describe(words)
        assert (description["label"], description["base"], description["given"]) == (label, base, stated)
        assert description["editable"] == (not description["look"]), words
        for name in set(stated) - {"file"}:
            assert description["values"][name] == stated[name] != description["usual"][name]


@pytest.mark.parametrize("moved_parameter", ["roughness", "baseColor", "", "nothing", "variant"])
def test_a_faster_surface_has_the_same_f(moved_parameter: str) -> None:
    subject = read_subject("disney:roughness=.3,clearcoat=.5")
    accelerated = accelerate(subject, moved_parameter)
    assert accelerated.evaluate_fast is not None
    assert accelerated.evaluate_fast(WO, WI) == pytest.approx(evaluate(subject.bsdf, WO, WI), rel=1e-12)


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.draft])
def test_a_draft_is_near_what_it_is_a_draft_of(kind: str, surfaces: Surfaces) -> None:
    draft, fine = (surfaces.values(kind, "lambert", PlotOptions(), draft) for draft in (True, False))
    assert set(draft) == set(fine)
    name, scale = ("f", 1.0) if kind == "albedo" else ("value", 1.0 / np.pi)
    assert abs(draft[name].max() - fine[name].max()) < 0.05 * scale


@pytest.mark.parametrize(
    "words", ["disney:roughness=.3,baseColor=.8/.2/.1", "ward:alphaX=.3", "measured:file=scans/satin.binary"]
)
def test_a_look_as_usd_is_the_surface(words: str, surfaces: Surfaces, tmp_path: Path) -> None:
    file = tmp_path / "copied.usda"
    file.write_text(usd_text(surfaces, words))
    subject = surfaces.subject(words)
    (copied,) = read_look(file).layers
    assert copied.inputs.keys() == look_from_layers(subject.layers, "a").layers[0].inputs.keys()
    # USD has floats in float32.
    assert evaluate(read_subject(str(file)).bsdf, WO, WI) == pytest.approx(evaluate(subject.bsdf, WO, WI), rel=1e-5)


def test_a_command_has_paths_and_the_options_that_are_used(surfaces: Surfaces, roots: Path) -> None:
    text = surfaces.command("retro", ["a b=scans/satin.binary", "disney"], PlotOptions(scale="log", exposure=2.0))
    assert shlex.split(text) == [
        "lookdev", "plot", "retro", f"a b={roots / 'satin.binary'}", "disney", "-o", "retro.png", "--scale", "log",
    ]  # fmt: skip


def test_files_of_the_command_line_get_names(surfaces: Surfaces, tmp_path: Path) -> None:
    file = tmp_path / "my scan.binary"
    file.touch()
    assert add_file_to_roots(f"a={file}", surfaces.roots) == "a=my_scan.binary"
    assert add_file_to_roots(f"measured:file={file},scale=2", surfaces.roots) == "measured:file=my_scan.binary,scale=2"
    assert add_file_to_roots("disney:roughness=.1", surfaces.roots) == "disney:roughness=.1"
    assert surfaces.roots.locate("my_scan.binary") == file
    with pytest.raises(LookdevError, match="--root"):
        surfaces.roots.locate("my_scan.binary/../../x")


def test_threads_that_ask_at_once_prepare_a_measurement_once(tmp_path: Path) -> None:
    file = tmp_path / "asked.dat"
    write_anisotropic(file, np.full((2, 2, 2, 2, 3), 0.1))
    make = Mock(side_effect=lambda grid: time.sleep(0.1))  # in which the other threads ask
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(4) as threads:
        patch.setattr("lookdev.brdf.measured.make_proposal", make)
        list(threads.map(lambda _: read_subject(str(file)), range(4)))
    make.assert_called_once()


def test_numbers_beyond_float32_are_its_largest() -> None:
    message = encode_packet({"id": 1}, {"f": np.array([1e300, -1e300, 2.0])})
    assert np.frombuffer(message[-12:], "<f4").tolist() == [np.finfo(np.float32).max, np.finfo(np.float32).min, 2.0]


def test_every_continuous_model_is_described(surfaces: Surfaces) -> None:
    for name in CONTINUOUS_MODELS:
        words = "measured:file=scans/satin.binary" if name == "measured" else name
        assert surfaces.describe(words)["editable"]
