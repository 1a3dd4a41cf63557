"""The cases of the check "stability": parameters at the ends of their ranges, grazing directions, degenerate scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from lookdev.arrays import Bools, Floats, Indices
from lookdev.asset import Asset, Instance, Mesh
from lookdev.asset.builtin import make_sphere
from lookdev.asset.store import make_asset
from lookdev.brdf import MODELS, Parameter
from lookdev.brdf.angles import direction_at_cosine
from lookdev.brdf.frames import ZENITH
from lookdev.checks.evaluate import Batch, round_to_float32
from lookdev.codegen.points import PointLayer
from lookdev.light import EnvironmentMap, make_environment

Rng = np.random.Generator

# The positions of parameters in their ranges: 0 is the lower end, 1 the upper end. Extreme positions reach the denormal
# numbers of float32.
_FRACTIONS = (0.0, 1e-4, 0.01, 0.5, 1.0 - 1e-4, 1.0)
_EXTREME_FRACTIONS = (1e-7, 1e-12, 1e-20, 1e-30, 1e-40, 1.0 - 2.0**-24)
# Cosines between directions and the normal. Below 1e-7 a direction is on the horizon in float32.
_COSINES = (1.0, 0.9, 0.3, 1e-2, 1e-4, 1e-5, 1e-6, 1e-7)
_EXTREME_COSINES = (0.0, 1e-12, 1e-18, 1e-20, 1e-30, 1e-37, 1e-40, 1e-45)


@dataclass(frozen=True, eq=False)
class ExtremeCases:
    """Cases of a stack of layers, with numbers that float32 represents exactly.

    `comparable` is a mask (n,) of the cases in which results in float32 can be compared with float64.
    """

    batch: Batch
    comparable: Bools


def extreme_cases(layers: Sequence[PointLayer], count: int, rng: Rng) -> ExtremeCases:
    """Draw random cases of a stack of layers; the second half has extreme numbers and cosines far below 1e-7.

    The directions wo and wi are independent, equal, mirrored, nearly mirrored, or opposite along the horizon. If the
    surface is two-sided, wi is also behind it in some cases, or exactly opposite to wo, or both are behind it. About
    half of the cases have random normals. Comparable cases with nearly opposite grazing directions have the default
    normal, because their half vector is only rounding error.
    """
    is_extreme = np.arange(count) >= count // 2
    wo, wi = _draw_directions(count, is_extreme, rng, two_sided=any(MODELS[layer.model].two_sided for layer in layers))
    opposed = (np.linalg.norm((wo + wi)[:, :2], axis=-1) < 0.1) & (np.abs(wo[:, 2]) < 0.1) & (np.abs(wi[:, 2]) < 0.1)
    has_default_normal = (rng.random(count) < 0.5) | (opposed & ~is_extreme)
    numbers = tuple(_draw_numbers(layer, count, is_extreme, has_default_normal, rng) for layer in layers)
    return ExtremeCases(Batch(tuple(layers), wo, wi, numbers), ~is_extreme)


def moderate_numbers(layers: Sequence[PointLayer], count: int, rng: Rng) -> tuple[dict[str, Floats], ...]:
    """Draw numbers that do not amplify light: scales are at most 1, normals are (0, 0, 1), options are the defaults.

    Returns a dictionary for each layer, with arrays (count,) or (count, 3) by name.
    """
    no_case, all_cases = np.zeros(count, np.bool_), np.ones(count, np.bool_)
    drawn = []
    for layer in layers:
        numbers = _draw_numbers(layer, count, no_case, all_cases, rng)
        option_defaults = MODELS[layer.model].optional_defaults()
        numbers |= {name: np.full(count, default) for name, default in option_defaults.items() if name in numbers}
        drawn.append({n: np.minimum(v, 1.0) if _amplifies(layer.model, n) else v for n, v in numbers.items()})
    return tuple(drawn)


def _amplifies(model: str, name: str) -> bool:
    """Return whether a parameter is a scale: a number with a default of at most 1, which can add energy above 1."""
    parameter = MODELS[model].parameters.get(name)
    return parameter is not None and isinstance(parameter.default, float) and parameter.default <= 1.0


def _draw_directions(count: int, is_extreme: Bools, rng: Rng, *, two_sided: bool) -> tuple[Floats, Floats]:
    """Draw the directions wo and wi (count, 3) of `extreme_cases`."""

    def draw_cosines(first: int) -> Floats:
        """Draw cosines from `_COSINES[first:]` or, in extreme cases, mostly from `_EXTREME_COSINES`."""
        usual, extreme = rng.choice(_COSINES[first:], count), rng.choice(_EXTREME_COSINES, count)
        return np.where(is_extreme & (rng.random(count) < 0.7), extreme, usual)

    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    wo = direction_at_cosine(draw_cosines(0), phi)
    # The relation of wi to wo: 0 independent, 1 equal, 2 mirrored, 3 nearly mirrored, 4 opposite at the horizon.
    kind = rng.integers(5, size=count)[:, None]
    wo = np.where(kind == 4, direction_at_cosine(draw_cosines(3), phi), wo)
    opposed = direction_at_cosine(draw_cosines(3), phi + np.pi + rng.choice([0, 1e-7, 1e-4, 1e-3], count))
    mirrored = wo * (-1.0, -1.0, 1.0)
    near = mirrored + rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-7.0, -1.0, (count, 1))
    near[:, 2] = np.abs(near[:, 2])
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    random_wi = direction_at_cosine(draw_cosines(0), rng.uniform(0.0, 2.0 * np.pi, count))
    wi = np.select([kind == 0, kind == 1, kind == 2, kind == 3], [random_wi, wo, mirrored, near], opposed)
    if two_sided:
        through, straight, behind = (rng.random((count, 1)) < share for share in (0.4, 0.1, 0.2))
        wi = np.where(straight, -wo, np.where(through, wi * (1.0, 1.0, -1.0), wi))
        wo, wi = (np.where(behind, -w, w) for w in (wo, wi))
    return round_to_float32(wo), round_to_float32(wi)


def _draw_numbers(
    layer: PointLayer, count: int, is_extreme: Bools, has_default_normal: Bools, rng: Rng
) -> dict[str, Floats]:
    """Draw the numbers of a layer that are not constants, (count,) or (count, 3), by name."""
    declared = MODELS[layer.model].parameters
    # In a few cases all numbers have their minimum at once, so that the surface is black.
    is_minimal = rng.random(count) < 0.02
    numbers = {}
    for name in layer.shapes():
        if name not in layer.constants:
            parameter = declared.get(name) or Parameter("mask", "float", 0.5)
            if parameter.kind == "normal":
                numbers[name] = _draw_normals(count, has_default_normal, rng)
            else:
                values = _draw_values(parameter, count, is_extreme, rng)
                values[is_minimal] = parameter.hard[0]
                numbers[name] = _round_within(values, *parameter.hard)
    return numbers


def _draw_values(parameter: Parameter, count: int, is_extreme: Bools, rng: Rng) -> Floats:
    """Draw values of a parameter in its hard range; about a third are the default."""
    shape = (count,) if parameter.kind == "float" else (count, 3)
    low, high = parameter.hard
    fraction = rng.choice(_FRACTIONS, shape)
    uses_extreme = (rng.random(shape) < 0.3) & (is_extreme if len(shape) == 1 else is_extreme[:, None])
    fraction = np.where(uses_extreme, rng.choice(_EXTREME_FRACTIONS, shape), fraction)
    return np.where(rng.random(shape) < 0.3, parameter.default, low + (high - low) * fraction)


def _draw_normals(count: int, has_default_normal: Bools, rng: Rng) -> Floats:
    """Draw normals (count, 3) of any length but zero, some of them along axes or nearly so."""
    normals = rng.uniform(-1.0, 1.0, (count, 3))
    normals = np.where(rng.random((count, 1)) < 0.2, rng.choice([-1.0, 0.0, 1e-12, 1.0], (count, 3)), normals)
    normals[has_default_normal | ~normals.any(axis=-1)] = ZENITH
    return round_to_float32(normals)


def _round_within(values: Floats, low: float, high: float) -> Floats:
    """Round values to float32; a value that would leave the range is rounded into it."""
    rounded = round_to_float32(values)
    inwards = np.where(rounded < low, np.inf, np.where(rounded > high, -np.inf, rounded))
    return round_to_float32(np.nextafter(rounded.astype(np.float32), inwards.astype(np.float32)))


@dataclass(frozen=True, eq=False)
class SceneCase:
    """A scene whose picture has a known property: an asset under an environment map.

    If `base_case` is the name of another case, the picture must equal `gain` times the picture of that case.
    """

    name: str
    asset: Asset
    light: EnvironmentMap
    base_case: str = ""
    gain: float = 1.0

    @property
    def is_white(self) -> bool:
        """Whether the light is white everywhere, so that no pixel may be brighter than the surface's albedo."""
        return bool((self.light.radiance == 1.0).all())

    @property
    def is_black(self) -> bool:
        """Whether there is no light, so that every pixel must be exactly 0."""
        return not self.light.radiance.any()


def scene_cases() -> tuple[SceneCase, ...]:
    """Return scenes whose pictures have known relations; each has one mesh, with UVs ``st`` and without primvars.

    The scenes suit only looks without anisotropy and textures, because UVs without area do not define a tangent.
    """
    pair, lamp, sun = _make_pair(), _lamp_light(), _sun_light()
    far = (1e5, -5e4, 2e4)
    return (
        SceneCase("usual", pair, lamp),
        SceneCase("0.1 mm", _make_pair(scale=1e-4), lamp, "usual"),
        SceneCase("10 km", _make_pair(scale=1e4), lamp, "usual"),
        SceneCase("100 km away", _make_pair(offset=far), lamp, "usual"),
        SceneCase("0.1 mm, 100 km away", _make_pair(scale=1e-4, offset=far), lamp, "usual"),
        SceneCase("degenerate triangles", _make_pair(_add_degenerate_triangles), lamp, "usual"),
        SceneCase("zero-area UVs", _make_pair(_flatten_uvs), lamp, "usual"),
        SceneCase("flipped normals", _make_pair(lambda mesh: replace(mesh, normals=-mesh.normals)), lamp, "usual"),
        SceneCase("light times 1e6", pair, _scale_light(lamp, 1e6), "usual", 1e6),
        SceneCase("sun of a texel", pair, sun),
        SceneCase("sun of a texel, 1e6", pair, _scale_light(sun, 1e6), "sun of a texel", 1e6),
        SceneCase("black", pair, _scale_light(lamp, 0.0)),
        SceneCase("white", pair, _white_light()),
        *random_normal_scenes(),
    )


def random_normal_scenes() -> tuple[SceneCase, ...]:
    """Return scenes that suit every look: with random normals, degenerate triangles and UVs without area."""
    hostile = _make_pair(lambda mesh: _randomize_normals(_flatten_uvs(_add_degenerate_triangles(mesh))))
    return (
        SceneCase("normals anywhere", hostile, _white_light()),
        SceneCase("normals anywhere, sun of 1e6", hostile, _scale_light(_sun_light(), 1e6)),
    )


def _make_pair(
    change: Callable[[Mesh], Mesh] = lambda mesh: mesh, scale: float = 1.0, offset: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Asset:
    """Return an asset of two spheres that occlude and reflect each other; `change` alters the mesh of a sphere.

    The asset is scaled by `scale` and moved by `offset`, in metres.
    """
    ball = make_sphere(segments=64, rings=32)
    instances = []
    for size, position in ((1.0, (0.0, 0.0, 0.0)), (0.4, (1.2, -0.8, 0.5))):
        matrix = np.diag([size * scale] * 3 + [1.0])
        matrix[:3, 3] = np.array(offset) + scale * np.array(position)
        instances.append(Instance(0, matrix))
    return make_asset("pair", [change(ball.meshes[0])], instances, ball.slots)


def _add_degenerate_triangles(mesh: Mesh) -> Mesh:
    """Add triangles without area: some have one corner three times, some have an edge back and forth."""
    starts = np.arange(0, len(mesh.corner_points) - 3, 97)  # at every 97th corner
    added = np.concatenate([np.stack([starts, starts + offset, starts], axis=-1) for offset in (0, 1)]).ravel()
    corners = np.concatenate([np.arange(len(mesh.corner_points)), added])
    faces = len(added) // 3
    return replace(
        _select_corners(mesh, corners),
        face_sizes=np.concatenate([mesh.face_sizes, np.full(faces, 3, np.int32)]),
        face_slots=np.concatenate([mesh.face_slots, np.zeros(faces, np.int32)]),
    )


def _select_corners(mesh: Mesh, corners: Indices) -> Mesh:
    """Return a mesh that has only the attributes of the corners `corners`; the caller adapts the faces."""
    return replace(
        mesh,
        corner_points=mesh.corner_points[corners],
        normals=mesh.normals[corners],
        tangents=None if mesh.tangents is None else mesh.tangents[corners],
        uvs={name: uv[corners] for name, uv in mesh.uvs.items()},
    )


def _flatten_uvs(mesh: Mesh) -> Mesh:
    """Return a mesh with the same UVs at all corners, and without tangents."""
    return replace(mesh, uvs={"st": np.full_like(mesh.uvs["st"], 0.5)}, tangents=None)


def _randomize_normals(mesh: Mesh) -> Mesh:
    """Return a mesh with random normals, uniform over all directions."""
    normals = np.random.default_rng(0).normal(size=mesh.normals.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return replace(mesh, normals=normals.astype(np.float32))


def _white_light() -> EnvironmentMap:
    return make_environment("stress", np.ones((4, 8, 3)))


def _lamp_light() -> EnvironmentMap:
    """Return a broad lamp in dim surroundings."""
    height, width = 16, 32
    v, u = (np.mgrid[:height, :width] + 0.5) / np.array([height, width])[:, None, None]
    beam = np.exp(6.0 * (np.cos(2.0 * np.pi * (u - 0.3)) * np.sin(np.pi * v) - 1.0))
    return make_environment("stress", 0.1 + 2.0 * beam[..., None] * (1.0, 0.8, 0.6))


def _sun_light() -> EnvironmentMap:
    """Return a map that is black except for one texel."""
    radiance = np.zeros((64, 128, 3))
    radiance[20, 40] = (1.0, 0.8, 0.6)
    return make_environment("stress", radiance)


def _scale_light(light: EnvironmentMap, gain: float) -> EnvironmentMap:
    return make_environment("stress", gain * light.radiance.astype(np.float64))
