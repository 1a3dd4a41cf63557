"""Measured reflectance inside Cycles, in float32: values compared with float64 look-ups, and pictures."""

import json
import tempfile
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from agreement import assert_agreement, shape_pixels
from frames import RenderScene
from looks import quick_among
from stored_references import Arrays, StoredReference

from lookdev.brdf import complete_parameters, model_named
from lookdev.brdf.measured import BUILT_IN, proposal
from lookdev.brdf.measured.synthetic import write_synthetic
from lookdev.checks.evaluate import evaluate_lines
from lookdev.checks.points import check_points
from lookdev.codegen.osl import block
from lookdev.material import Layer, Look

pytestmark = [pytest.mark.cycles, pytest.mark.usefixtures("warm_points")]

FileOf = Callable[[str], Path]

VIEWS = 8  # along each axis, of the tables by which directions are drawn: other samples, and another reference
PARAMETERS: dict[str, dict[str, Any]] = {
    "plastic": {"baseColor": (0.5, 0.2, 0.1), "roughness": 0.35},
    "satin": {"baseColor": (0.5, 0.4, 0.1), "roughness": 0.6, "anisotropic": 0.7, "metallic": 0.8},
}


@pytest.fixture(autouse=True, scope="module")
def _small_tables() -> Iterator[None]:
    """Sample anisotropic data with a quarter of the tables, which take seconds; the cache is of this module alone."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(proposal, "_VIEW_CELLS", proposal._VIEW_CELLS | {True: (VIEWS, VIEWS)})
        patch.setattr("lookdev.brdf.measured._make_cached_proposal", lru_cache(proposal.make_proposal))
        yield


def write_measured(folder: Path, name: str) -> Path:
    """Write synthetic measurements of Disney's model: isotropic, or anisotropic in another format."""
    parameters = PARAMETERS[name]
    file = folder / (f"{name}.dat" if "anisotropic" in parameters else f"{name}.binary")
    write_synthetic(file, model_named("disney").bsdf(complete_parameters("disney", parameters)))
    return file


@pytest.fixture(scope="module")
def file_of(tmp_path_factory: pytest.TempPathFactory) -> FileOf:
    folder = tmp_path_factory.mktemp("measured")
    return cache(lambda name: Path(name) if name == BUILT_IN else write_measured(folder, name))


def measured_pixels(name: str, **case: Any) -> Arrays:
    """Return pixels of a sphere of measured data; the digest of the stored reference has the name of the data."""
    with tempfile.TemporaryDirectory() as folder:
        file = write_measured(Path(folder), name)
        return shape_pixels(layers=[Layer("base", "measured", {"file": str(file)})], **case)


def _lines(file: Path, interpolation: str) -> list[str]:
    """Return cases in float32 numbers, half of them near the mirror direction, some grazing."""
    rng = np.random.default_rng(8)
    count = 3000
    cos = rng.uniform(0.0, 1.0, (2, count))
    cos[:, : count // 8] = 10.0 ** rng.uniform(-3.0, 0.0, (2, count // 8))
    phi = rng.uniform(0.0, 2.0 * np.pi, (2, count))
    sin = np.sqrt(1.0 - cos * cos)
    wo, wi = np.stack([sin * np.cos(phi), sin * np.sin(phi), cos], axis=-1)
    near = wo * [-1.0, -1.0, 1.0] + rng.normal(size=wo.shape) * 10.0 ** rng.uniform(-4.0, 0.0, (count, 1))
    near[:, 2] = np.abs(near[:, 2])
    wi[::2] = (near / np.linalg.norm(near, axis=-1, keepdims=True))[::2]
    case = {"model": "measured", "params": {"file": str(file), "interpolation": interpolation}}
    pairs = zip(wo.astype(np.float32).tolist(), wi.astype(np.float32).tolist(), strict=True)
    return [json.dumps({**case, "wo": o, "wi": i}) for o, i in pairs]


@pytest.mark.parametrize(
    ("name", "interpolation", "arrays"),
    quick_among(
        list(product((BUILT_IN, *PARAMETERS), ("linear", "nearest"), (True, False))),
        # Linear look-ups in arrays are those of the points of a look; others than the built-in are those of a sphere.
        [(BUILT_IN, "nearest", False)],
    ),
)
def test_values_in_float32(name: str, interpolation: str, arrays: bool, file_of: FileOf, monkeypatch) -> None:
    if not arrays:
        monkeypatch.setattr(block, "_MAX_ARRAY_SIZE", 10_000)
    lines = _lines(file_of(name), interpolation)
    expected, got = (
        np.array([json.loads(line)["f"] for line in evaluate_lines(lines, backend)]) for backend in ("numpy", "cycles")
    )
    error = np.abs(got - expected) / np.maximum(expected, 1e-4)
    assert (error < 2e-4).mean() > 0.99
    if interpolation == "linear":
        assert error.max() < 0.05
    else:
        # Roundings of an angle put a few directions in a thousand into the cell beside.
        assert (error < 0.05).mean() > 0.998
    assert np.count_nonzero(expected > 1e-4) > expected.size // 2


@pytest.mark.parametrize("name", [pytest.param("plastic", marks=pytest.mark.proof), "satin"])
def test_a_sphere_agrees_with_the_reference(
    name: str, file_of: FileOf, render: RenderScene, light_of: Any, stored_reference: StoredReference
) -> None:
    layers, light = [Layer("base", "measured", {"file": str(file_of(name))})], light_of("studio")
    frames = [render("sphere", layers, light, samples=32, seed=seed, size=40) for seed in range(4)]

    def stored(label: str, compute: object, *, layers: object, **case: Any) -> Arrays:
        return stored_reference(f"measured {name} by {VIEWS} views", measured_pixels, name=name, **case)

    assert_agreement(frames, layers, "sphere", light, stored=stored)


def measured_look(file: str) -> Look:
    return Look("look", (Layer("base", "measured", {"file": file}),))


@pytest.mark.parametrize("name", quick_among([(BUILT_IN,), *((name,) for name in PARAMETERS)], [(BUILT_IN,)]))
def test_points_of_a_look_agree(name: str, file_of: FileOf) -> None:
    look = measured_look(str(file_of(name)))
    assert check_points(look, count=2000 if name == BUILT_IN else 8000).passed


@pytest.mark.proof
def test_shifted_look_ups_are_found() -> None:
    assert not check_points(measured_look(BUILT_IN), count=400, alter=lambda osl: osl.replace("0.5", "0.501")).passed
