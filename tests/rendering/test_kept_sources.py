"""Cached sources equal generated ones, and change with every value and image that they depend on."""

import itertools
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest

from lookdev.brdf import CONTINUOUS_MODELS, MODELS
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import GeneratedSource, ShaderSource
from lookdev.light import Dome, prepare_light
from lookdev.light.dome.environment import make_environment
from lookdev.material import Bump, Coordinates, Formula, Layer, Look, Primvar, Texture
from lookdev.material.expression import parse
from lookdev.rendering.backends import BACKENDS, Backend
from lookdev.rendering.source_cache import cached_source
from lookdev.scene import Sampling

GREY = Look("grey", (Layer("Grey", "disney", {"roughness": 0.1 + 0.2, "baseColor": (0.1, 1 / 3, 2e-7)}),))
CountingBackend = tuple[Backend, list[str]]


@pytest.fixture
def light(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Dome:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    return prepare_light(make_environment("grey", np.ones((4, 8, 3), np.float32)))


@pytest.fixture
def counting_backend() -> CountingBackend:
    """Return the exact backend, and a list of the looks that it has generated."""
    generated: list[str] = []

    def generate(look: Look, setting: SourceSetting) -> GeneratedSource:
        generated.append(look.name)
        return BACKENDS["exact"].generate(look, setting)

    return replace(BACKENDS["exact"], generate=generate), generated


def write_map(file: Path, value: float) -> Path:
    output = oiio.ImageOutput.create("exr")
    spec = oiio.ImageSpec(4, 4, 3, oiio.FLOAT)
    spec.attribute("compression", "none")  # so that size does not depend on values
    assert output.open(str(file), spec)
    assert output.write_image(np.full((4, 4, 3), value, np.float32))
    output.close()
    return file


def setting_of(light: Dome, **sampling: int) -> SourceSetting:
    return SourceSetting((light,), (8, 8), Sampling(samples=4, **sampling))


@pytest.mark.parametrize("model", CONTINUOUS_MODELS)
def test_a_kept_source_is_the_generated_one(
    model: str, light: Dome, counting_backend: CountingBackend, tmp_path: Path
) -> None:
    backend, generated = counting_backend
    layers = (Layer("Base", model, dict(MODELS[model].probe)), Layer("Dust", "disney", mask=Primvar("dust", 0.5)))
    map_ = Texture(write_map(tmp_path / "map.exr", 0.25), "r", "raw")
    bumpy = Layer("Bumpy", "disney", {"roughness": map_, "normal": Bump(map_, 0.1)}, mask=map_)
    look, setting = Look("any", (*layers, bumpy)), setting_of(light)
    expected = BACKENDS["exact"].generate(look, setting)
    first, second = (cached_source(backend, look, setting, ()) for _ in range(2))
    assert first == second == expected
    assert hash(second) == hash(expected)
    assert generated == ["any"] * (
        2 if any(parameter.file is not None for parameter in MODELS[model].parameters.values()) else 1
    )


def test_what_a_source_depends_on_makes_another(light: Dome, counting_backend: CountingBackend) -> None:
    backend, generated = counting_backend
    layer = GREY.layers[0]
    looks = [
        GREY,
        replace(GREY, name="other"),
        replace(GREY, layers=(replace(layer, inputs={**layer.inputs, "roughness": 0.3}),)),  # not 0.1 + 0.2
        replace(GREY, layers=(layer, replace(layer, mask=0.5))),
    ]
    settings = [setting_of(light), setting_of(light, bounces=3), replace(setting_of(light), shadows=False)]
    settings.append(replace(settings[0], resolution=(8, 9)))
    for look, setting, light_code in itertools.product(looks, settings, ((), ("another kind",))):
        cached_source(backend, look, setting, light_code)
    cached_source(backend, replace(GREY, source="elsewhere.usda"), settings[0], ())
    assert len(generated) == len(looks) * len(settings) * 2


def test_the_content_of_an_image_decides(light: Dome, counting_backend: CountingBackend, tmp_path: Path) -> None:
    backend, generated = counting_backend
    file, setting = write_map(tmp_path / "map.exr", 0.25), setting_of(light)
    times, content = file.stat(), file.read_bytes()
    look = Look("mapped", (Layer("Base", "disney", {"roughness": Texture(file, "r", "raw")}),))

    def source() -> ShaderSource:
        cached = cached_source(backend, look, setting, ())
        assert isinstance(cached, ShaderSource)
        return cached

    first = source()
    write_map(file, 0.75)
    # Size and time are the same.
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert (file.stat().st_size, file.stat().st_mtime_ns) == (times.st_size, times.st_mtime_ns)
    second = source()
    assert first.images != second.images
    assert second == BACKENDS["exact"].generate(look, setting)
    file.write_bytes(content)
    assert source() == first
    assert generated == ["mapped"] * 2
    first.images[0].path.unlink()  # of the cache
    assert source().images[0].is_whole()
    assert generated == ["mapped"] * 3


def test_what_more_may_affect_is_generated_anew(light: Dome, counting_backend: CountingBackend, tmp_path: Path) -> None:
    backend, generated = counting_backend
    setting = setting_of(light)
    noise = Formula(parse("noise(uv[0], uv[1])"), {"uv": Coordinates("st")}, {"uv": "color"})
    missing = Texture(tmp_path / "no.exr", "r", "raw")
    tiles = Texture(write_map(tmp_path / "tile.1001.exr", 0.5).with_name("tile.<UDIM>.exr"), "r", "raw")
    looks = [
        Look("formula", (GREY.layers[0], Layer("Noise", "disney", mask=noise))),
        Look("unread", (GREY.layers[0], Layer("Unread", "disney", {"roughness": missing}, mask=0.0))),
        Look("tiles", (Layer("Tiles", "disney", {"roughness": tiles}),)),
    ]
    for look in (*looks, *looks):
        cached_source(backend, look, setting, ())
    assert generated == [look.name for look in looks] * 2


def test_a_damaged_record_is_made_again(light: Dome, counting_backend: CountingBackend, tmp_path: Path) -> None:
    backend, generated = counting_backend
    first = cached_source(backend, GREY, setting_of(light), ())
    (record,) = (tmp_path / "cache" / "sources").iterdir()
    record.write_text(record.read_text().replace("0.3333333333333333", "0.4333333333333333"))
    assert cached_source(backend, GREY, setting_of(light), ()) == first
    assert generated == ["grey"] * 2
