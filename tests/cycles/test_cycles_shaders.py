"""The hand-written OSL headers, run inside Cycles, against NumPy."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import NDArray
from osl_snippets import evaluate
from warm_blender import BlenderCallError, BlenderProcess

from lookdev.arrays import Floats, Floats32, Ints32
from lookdev.codegen.osl.light import light_sections
from lookdev.codegen.source import ShaderSource
from lookdev.codegen.templates import expand_template
from lookdev.light import Dome, make_environment, prepare_light
from lookdev.light.dome import bins
from lookdev.light.dome.environment import read_exr
from lookdev.light.dome.slots import MOST_POINTS, SLOTS
from lookdev.light.dome.warp import lookup
from lookdev.light.mapping import rotate_z, uv_to_direction
from lookdev.material import Texture
from lookdev.material.textures import linear_texture, sample_slopes, sample_texture, slope_texture

pytestmark = [pytest.mark.cycles, pytest.mark.both_pythons]


_WRAPS = {"black": "black", "clamp": "clamp", "repeat": "periodic", "mirror": "mirror"}
_SAMPLES = (1, 2, 4, 8, 16, 64)
_SEEDS = (0, 1, 77, -5)
_NET = 10  # 2^10 points
_TURN = 0.7
_RNG = 20120808
# A few operations on numbers around 1, at 2^-24 each.
_ROUNDING = 2e-6


@dataclass(frozen=True)
class Probes:
    """Tables of numbers, as float64, and the values at them, by name; and the files read.

    `points`, `slots` and `numbers`, those of its bins, are the light's.
    """

    tables: dict[str, Floats]
    values: dict[str, Floats]
    image: Texture
    light: Dome
    points: Floats32
    slots: Ints32
    numbers: Floats32


def _texture_code(function: str, file: Callable[[Any, Any], Path], value: str) -> str:
    """Look the image up with the pair of wraps that in[2] numbers; in OSL wrap modes are constants."""
    branches = ""
    for number, (s, t) in enumerate(product(_WRAPS, repeat=2)):
        call = f'{function}("{file(s, t)}", in[0], in[1], "{_WRAPS[s]}", "{_WRAPS[t]}", alpha)'
        branches += f"if (pair == {number}) looked = {call};\n"
    return f"int pair = int(in[2] + 0.5); float alpha = -1; color looked = 0;\n{branches}value = {value};"


def _normals(rng: np.random.Generator) -> Floats:
    """Return normals and turns (n, 4): anywhere, about the poles, and on them."""
    normal = rng.normal(size=(4096, 3))
    normal[:256, :2] *= 1e-3
    normal[:8, :2] = 0.0
    turn = rng.uniform(-7.0, 7.0, (4096, 1))
    return np.concatenate([normal / np.linalg.norm(normal, axis=-1, keepdims=True), turn], axis=-1)


def _texture_places() -> Floats:
    rng = np.random.default_rng(_RNG)
    count = 256
    st = rng.uniform(-2.6, 3.6, (16, count, 2))
    # Texel centres and the edges of the image, exactly.
    st[:, :64] = np.round(st[:, :64] * 16.0) / 16.0
    pairs = np.broadcast_to(np.arange(16.0)[:, None, None], (16, count, 1))
    return np.concatenate([st, pairs], axis=-1).reshape(-1, 3)


@pytest.fixture(scope="module")
def probes(blender: BlenderProcess, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Probes]:
    folder = tmp_path_factory.mktemp("probes")
    rng = np.random.default_rng(_RNG)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("LOOKDEV_CACHE", str(folder / "cache"))
        pixels = rng.random((4, 8, 4)).astype(np.float32)
        OpenEXR.File({}, {"RGBA": pixels}).write(str(folder / "image.exr"))
        image = Texture(folder / "image.exr", "rgb", "raw")
        linear = linear_texture(image)

        def slopes(s: Any, t: Any) -> Path:
            return slope_texture(replace(image, channel="g", wrap_s=s, wrap_t=t))

        # A light whose texels differ a thousandfold, so that a look-up in the wrong place is seen.
        radiance = (10.0 ** rng.uniform(-1.0, 2.0, (16, 32, 3))).astype(np.float32)
        light = prepare_light(make_environment("noise", radiance))
        constants, functions = light.code(sampled=True).constants, light_sections([light])["light_functions"]
        headers = "".join(expand_template(f"{name}.h", {}) for name in ("texture", "sobol", "stratum"))
        headers = "\n".join(["#define IBL_SAMPLES 1", *constants, headers, *functions])
        net = np.array([(index, seed) for seed in _SEEDS for index in range(2**_NET)], dtype=np.float64)
        square = rng.random((4096, 2))
        # Near the poles and the seam, too, and beyond it, as on a rotated map.
        square[:512] **= 8.0
        square[256:512] = 1.0 - square[256:512]
        beyond = square + [1.0, 0.0] * rng.integers(0, 2, (4096, 1))
        directions = uv_to_direction(square)
        normals = _normals(rng)
        # Samples of all bins, and of a few slots so often that most of their points occur. Hashed in the shader,
        # numbers and seeds have all 32 bits.
        drawn = np.stack([rng.integers(0, bins.COUNT, 8192), *rng.integers(0, 2**24, (2, 8192))], axis=-1)
        drawn[4096:, :2] = drawn[0, :2]
        drawn = np.concatenate([drawn, rng.uniform(-7.0, 7.0, (8192, 1))], axis=-1)
        sample_code = (
            "vector wi; float ratio; float within;"
            " int slot = dome_numbered(sobol_hash(int(in[1])), sobol_hash(int(in[2])), within); color got"
            f' = dome_sample(dome_slots, dome_bins, "{light.points_file.path}", int(in[0]), slot, within, in[3], wi, '
            "ratio);"
        )
        look_up_code = f'dome_look_up("{light.radiance_file.path}", in[0], in[1], DOME_WIDTH, DOME_HEIGHT)'
        bin_code = "vector axis; int bin = dome_bin(vector(in[0], in[1], in[2]), in[3], axis);"
        texels = np.array([(i, j) for j in range(4) for i in range(8)], dtype=np.float64)
        places = _texture_places()
        snippets: dict[str, tuple[Floats, str]] = {
            "texture": (places, _texture_code("lookdev_texture", lambda s, t: linear, "looked")),
            "alpha": (places, _texture_code("lookdev_texture", lambda s, t: linear, "color(alpha)")),
            "slopes": (places, _texture_code("lookdev_slopes", slopes, "looked")),
            "texel": (texels, f'value = lookdev_texel("{linear}", in[0], in[1], 8, 4);'),
            "sobol": (net, "float a; float b; sobol_2d(int(in[0]), int(in[1]), a, b); value = color(a, b, 0);"),
            "to_square": (
                directions,
                f"float x; float y; dome_place(vector(in[0], in[1], in[2]), {_TURN}, x, y); value = color(x, y, 0);",
            ),
            "radiance": (beyond, f"value = {look_up_code};"),
            "bin": (normals, f"{bin_code} value = color(bin);"),
            "axis": (normals, f"{bin_code} value = axis;"),
            "scale": (np.arange(float(bins.COUNT + 1))[:, None], "value = color(dome_bins[2 * int(in[0])]);"),
            "widened": (np.linspace(-1.0, 1.0, 4096)[:, None], "value = color(dome_widened(in[0]));"),
            "sample": (drawn, f"{sample_code} value = wi;"),
            "sample_radiance": (drawn, f"{sample_code} value = got;"),
            "sample_ratio": (drawn, f"{sample_code} value = color(ratio);"),
        }
        samples = {f"time{count}": count for count in _SAMPLES}
        for name, count in samples.items():
            code = "int index = stratum(time, SAMPLES); value = color(index == int(in[0]), index, index * index);"
            snippets[name] = np.arange(4096.0)[:, None] % count, code
        parameters = "int dome_slots[DOME_ALL_SLOTS] = {0}, float dome_bins[DOME_BIN_NUMBERS] = {0},"
        arrays = {"slots": np.load(light.slots_file.path), "numbers": np.load(light.bins_file.path)}
        array_parameters = {"dome_slots": arrays["slots"], "dome_bins": arrays["numbers"]}
        rounded, values = evaluate(blender, snippets, headers, parameters, array_parameters, samples)
        points = read_exr(light.points_file.path, "RGBA").reshape(-1, 4)
        yield Probes(rounded, values, image, light, points, **arrays)


@pytest.mark.parametrize(("wrap_s", "wrap_t"), list(product(_WRAPS, repeat=2)))
def test_textures_and_slopes_mean_the_same_as_in_numpy(probes: Probes, wrap_s: Any, wrap_t: Any) -> None:
    has_wraps = probes.tables["texture"][:, 2] == list(product(_WRAPS, repeat=2)).index((wrap_s, wrap_t))
    st = probes.tables["texture"][has_wraps, :2]
    image = replace(probes.image, wrap_s=wrap_s, wrap_t=wrap_t)
    results = {name: probes.values[name][has_wraps] for name in ("texture", "alpha", "slopes")}
    # A place is known to 2^-24 of up to 4, times 8 texels: the weights are off by as much.
    np.testing.assert_allclose(results["texture"], sample_texture(image, st), atol=1e-5)
    np.testing.assert_allclose(results["alpha"][:, 0], sample_texture(replace(image, channel="a"), st), atol=1e-5)
    # Slopes are up to 8 times larger.
    np.testing.assert_allclose(results["slopes"][:, :2], sample_slopes(replace(image, channel="g"), st), atol=1e-4)


def test_texels_are_exact(probes: Probes) -> None:
    column, row = ((probes.tables["texel"][:, k] + 0.5) / size for k, size in ((0, 8), (1, 4)))
    expected = sample_texture(probes.image, np.stack([column, 1.0 - row], axis=-1))
    np.testing.assert_array_equal(probes.values["texel"], expected)


@pytest.mark.parametrize("number", range(len(_SEEDS)))
def test_points_are_a_net_in_base_2(probes: Probes, number: int) -> None:
    points = probes.values["sobol"].reshape(len(_SEEDS), -1, 3)[number, :, :2]
    assert ((points >= 0.0) & (points < 1.0)).all()
    for length in (1, 2, 4, 2**7, 2**_NET):
        # Any first power of two of them too: one point in every elementary interval of that area.
        levels = length.bit_length() - 1
        for a in range(levels + 1):
            cell = np.floor(points[:length] * [2**a, 2 ** (levels - a)]).astype(int)
            assert len(np.unique(cell, axis=0)) == length


def test_seeds_give_other_points(probes: Probes) -> None:
    points = probes.values["sobol"].reshape(len(_SEEDS), -1, 3)[..., :2]
    for one, other in ((i, j) for i in range(len(_SEEDS)) for j in range(i)):
        # Independent numbers: the correlation of n pairs is about n^-1/2.
        correlation = np.corrcoef(points[one].ravel(), points[other].ravel())[0, 1]
        assert abs(correlation) < 5.0 / np.sqrt(2 ** (_NET + 1))


def test_the_map_and_its_inverse(probes: Probes) -> None:
    # x is periodic, and a turned map leaves [0, 1].
    xy = probes.values["to_square"][:, :2]
    back = rotate_z(uv_to_direction(xy * [1.0, -1.0] + [0.0, 1.0]), np.degrees(_TURN))
    # OSL's atan2 is an approximation: found to be good to 1e-5 radians, 0.003 texels of a map 2048 wide.
    np.testing.assert_allclose(back, probes.tables["to_square"][:, :3], atol=1.5e-5)
    assert ((xy[:, 1] >= 0.0) & (xy[:, 1] <= 1.0)).all()


def test_the_light_is_that_of_numpy(probes: Probes) -> None:
    x, y = probes.tables["radiance"][:, :2].T
    expected = lookup(probes.light.table, np.stack([x, 1.0 - y], axis=-1))
    # Texels up to 100; places known to 2^-24 of 32 texels.
    np.testing.assert_allclose(probes.values["radiance"], expected, rtol=1e-4, atol=1e-3)


def test_bins_are_those_of_numpy(probes: Probes) -> None:
    *normal, turn = probes.tables["bin"].T
    down = bins.ROWS * np.arccos(np.clip(normal[2], -1.0, 1.0)) / np.pi
    row = np.minimum(down.astype(int), bins.ROWS - 1)
    cells = np.array(bins.CELLS)[row]
    around = cells * ((np.arctan2(normal[1], normal[0]) - turn) / (2.0 * np.pi) % 1.0)
    expected = np.array(bins.FIRST)[row] + around.astype(int)
    got = probes.values["bin"][:, 0]
    # On the borders rounding and OSL's arc tangents, good to 1e-5, decide.
    inside = (np.abs(down - np.rint(down)) > 1e-4) & (np.abs(around - np.rint(around)) > 1e-4)
    assert inside.mean() > 0.9
    np.testing.assert_array_equal(got[inside], expected[inside])
    assert np.isin(got, np.arange(bins.COUNT)).all()
    assert len(np.unique(got)) == bins.COUNT


def test_axes_are_those_of_the_bins(probes: Probes) -> None:
    normal, turn = probes.tables["axis"][:, :3], probes.tables["axis"][:, 3]
    axis, number = probes.values["axis"], probes.values["bin"][:, 0].astype(int)
    np.testing.assert_allclose(axis, rotate_z(bins.AXES[number], np.degrees(turn)), atol=_ROUNDING)
    # Wherever rounding puts a normal: the bin's cone has it.
    assert ((axis * normal).sum(axis=-1) > np.cos(bins.RADIUS)).all()


def test_the_weight_of_a_bin_is_that_of_numpy(probes: Probes) -> None:
    np.testing.assert_array_equal(probes.values["scale"][:, 0], probes.numbers[:, 0])
    assert (probes.numbers > 0.0).all()
    # Rounding under the root matters only where the sine is small, and there the weight is 1 or 0.
    expected = bins.widened_cosine(probes.tables["widened"][:, 0])
    np.testing.assert_allclose(probes.values["widened"][:, 0], expected, atol=_ROUNDING)


def _hash(value: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Hash numbers like `sobol_hash`."""
    x = value ^ (value >> 16)
    x = x * np.uint32(0x7FEB352D)
    x = x ^ (x >> 15)
    x = x * np.uint32(0x846CA68B)
    return x ^ (x >> 16)


def test_samples_of_the_light_are_points_of_their_slots(probes: Probes) -> None:
    number, seed = _hash(probes.tables["sample"][:, 1:3].astype(np.uint32)).T
    bits = SLOTS.bit_length() - 1
    reverse = np.array([int(f"{n % SLOTS:0{bits}b}"[::-1], 2) for n in number])
    bin_number = probes.tables["sample"][:, 0].astype(int)
    slots = probes.slots[bin_number, reverse]
    first, count = (slots >> 12) & 0xFFFFF, slots & 4095
    # The light is broad: no point fills several slots.
    assert (count <= MOST_POINTS).all()
    expected = probes.numbers[bin_number, 1] * count
    np.testing.assert_allclose(probes.values["sample_ratio"][:, 0], expected, rtol=_ROUNDING)
    u = (_hash(seed ^ (number * np.uint32(0x2C1B3C6D) + np.uint32(0x297A2D39))) >> 8).astype(np.float32) / 2**24
    point = first + np.floor(count * u).astype(np.int64)
    # Many points of a slot that is drawn from often occur.
    assert (first[4096:] == first[-1]).all()
    assert len(np.unique(point[4096:])) > 0.9 * count[-1] > 100
    azimuth, z = probes.points[point, :2].astype(np.float64).T
    uv = np.stack([0.5 - azimuth / (2.0 * np.pi), 1.0 - np.arccos(z) / np.pi], axis=-1)
    expected = rotate_z(uv_to_direction(uv), np.degrees(probes.tables["sample"][:, 3]))
    np.testing.assert_allclose(probes.values["sample"], expected, atol=_ROUNDING)
    # 12 bits of thrice the mean for each channel; texels differ a thousandfold within one map: relative to the mean.
    light = lookup(probes.light.table, uv)
    mean = light.mean(axis=-1, keepdims=True)
    np.testing.assert_allclose(probes.values["sample_radiance"] / mean, light / mean, atol=2e-3)


@pytest.mark.parametrize("samples", _SAMPLES)
def test_time_counts_the_samples_of_a_pixel(probes: Probes, samples: int) -> None:
    # In each pixel one number occurs once among the samples; the sums check all numbers.
    indices = np.arange(samples)
    expected = np.array([1.0 / samples, indices.mean(), (indices**2).mean()])
    right = np.isclose(probes.values[f"time{samples}"], expected, rtol=1e-6)
    # Where a number is within 2e-6 of its stratum's end, rounding may put it into the next: at most 2e-6 N for each of
    # N samples and two ends. Four standard deviations of so few pixels come on top.
    doubt = 4e-6 * samples**2
    allowed = doubt + 4.0 * np.sqrt(doubt / len(right))
    assert (~right).mean(axis=0).max() <= allowed


def test_a_shader_that_does_not_compile_is_named(blender: BlenderProcess, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    source = ShaderSource("paint", "surface s(output color c = 0)\n{\n    c = nope;\n}\n", (), (), "")
    with pytest.raises(BlenderCallError) as caught:
        blender.call("lookdev.cycles.shaders.compile_osl", source)
    (refused,) = (file for file in (tmp_path / "cache").rglob("*") if file.is_file())
    number, line = next(row for row in enumerate(refused.read_text().splitlines(), 1) if "c = nope" in row[1])
    assert line.strip() == "c = nope;"
    location, reason = f"{refused}:{number}", "error: 'nope' was not declared in this scope"
    assert str(caught.value).strip() == f"RenderError: the shader of 'paint' does not compile: {location}: {reason}"


def test_arrays_are_read_from_memory(blender: BlenderProcess) -> None:
    """As constants of the compiled code, half a million numbers take longer to compile than all else."""
    oso = "shader s\nparam\tfloat[2]\tb\t0\t\t%read{1,2}\nparam\tint\tc\t7\nparam\tint[3]\ta\t0\t\t%read{3,4}\ncode\n"
    arrays = {"a": np.array([1, -2, 3], np.int32), "b": np.array([0.5, 0.1], np.float32)}
    mark = "%meta{int,interactive,1}"
    assert blender.call("probes.write_arrays", oso, arrays).split("\n")[1:4] == [
        f"param\tfloat[2]\tb\t0.5 0.100000001\t{mark} \t%read{{1,2}}",
        "param\tint\tc\t7",
        f"param\tint[3]\ta\t1 -2 3\t{mark} \t%read{{3,4}}",
    ]
