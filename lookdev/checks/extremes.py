"""The cases of the stress test: numbers at the ends of their ranges, grazing directions, degenerate scenes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from lookdev.asset import Asset, Instance, Mesh
from lookdev.asset.builtin import make_sphere
from lookdev.asset.store import make_asset
from lookdev.brdf import MODELS, Parameter
from lookdev.brdf.frames import ZENITH
from lookdev.checks.evaluate import Batch
from lookdev.codegen.points import PointLayer
from lookdev.light import EnvironmentMap, make_environment

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rng = np.random.Generator

# Places within a range, from its lower end; then absurd ones, down to float32's denormal numbers.
_PLACES = (0.0, 1e-4, 0.01, 0.5, 1.0 - 1e-4, 1.0)
_ABSURD = (1e-7, 1e-12, 1e-20, 1e-30, 1e-40, 1.0 - 2.0**-24)
# Cosines; below 1e-7 a direction is on the horizon in float32.
_HEIGHTS = (1.0, 0.9, 0.3, 1e-2, 1e-4, 1e-5, 1e-6, 1e-7)
_ABSURD_HEIGHTS = (0.0, 1e-12, 1e-18, 1e-20, 1e-30, 1e-37, 1e-40, 1e-45)


@dataclass(frozen=True, eq=False)
class Extremes:
    """Cases for both sides, exact in float32; `comparable` (n,) are those that float32 can resolve."""

    batch: Batch
    comparable: Mask


def extreme_cases(layers: Sequence[PointLayer], count: int, rng: Rng) -> Extremes:
    """Draw cases of a stack; the second half is absurd: tiny numbers, cosines far below 1e-7.

    Directions: anywhere, equal, mirrored, nearly mirrored, opposite along the horizon; for a two-sided surface also
    through it, straight or not, and from behind. Half of the cases have random normals, except where the directions are
    nearly opposite: their half vector is rounding.
    """
    absurd = np.arange(count) >= count // 2
    wo, wi = _directions(count, absurd, rng, thin=any(MODELS[layer.model].two_sided for layer in layers))
    opposed = (np.linalg.norm((wo + wi)[:, :2], axis=-1) < 0.1) & (np.abs(wo[:, 2]) < 0.1) & (np.abs(wi[:, 2]) < 0.1)
    straight = (rng.random(count) < 0.5) | (opposed & ~absurd)
    numbers = tuple(_numbers(layer, count, absurd, straight, rng) for layer in layers)
    return Extremes(Batch(tuple(layers), wo, wi, numbers), ~absurd)


def moderate_numbers(layers: Sequence[PointLayer], count: int, rng: Rng) -> tuple[dict[str, Floats], ...]:
    """Draw numbers for which energy has a bound: no scale amplifies, normals are straight, no option is taken."""
    nowhere, everywhere = np.zeros(count, np.bool_), np.ones(count, np.bool_)
    drawn = []
    for layer in layers:
        numbers, left_out = _numbers(layer, count, nowhere, everywhere, rng), MODELS[layer.model].options_left_out()
        numbers |= {name: np.full(count, default) for name, default in left_out.items() if name in numbers}
        drawn.append({n: np.minimum(v, 1.0) if _amplifies(layer.model, n) else v for n, v in numbers.items()})
    return tuple(drawn)


def _amplifies(model: str, name: str) -> bool:
    parameter = MODELS[model].parameters.get(name)
    return parameter is not None and isinstance(parameter.default, float) and parameter.default <= 1.0


def _directions(count: int, absurd: Mask, rng: Rng, *, thin: bool) -> tuple[Floats, Floats]:
    def heights(lowest: int) -> Floats:
        usual, odd = rng.choice(_HEIGHTS[lowest:], count), rng.choice(_ABSURD_HEIGHTS, count)
        return np.where(absurd & (rng.random(count) < 0.7), odd, usual)

    phi = rng.uniform(0.0, 2.0 * np.pi, count)
    wo = _direction(heights(0), phi)
    kind = rng.integers(5, size=count)[:, None]
    grazing = (
        _direction(heights(3), phi),
        _direction(heights(3), phi + np.pi + rng.choice([0, 1e-7, 1e-4, 1e-3], count)),
    )
    wo = np.where(kind == 4, grazing[0], wo)
    mirrored = wo * (-1.0, -1.0, 1.0)
    near = mirrored + rng.normal(size=(count, 3)) * 10.0 ** rng.uniform(-7.0, -1.0, (count, 1))
    near[:, 2] = np.abs(near[:, 2])
    near /= np.linalg.norm(near, axis=-1, keepdims=True)
    anywhere = _direction(heights(0), rng.uniform(0.0, 2.0 * np.pi, count))
    wi = np.select([kind == 0, kind == 1, kind == 2, kind == 3], [anywhere, wo, mirrored, near], grazing[1])
    if thin:
        through, straight, behind = (rng.random((count, 1)) < share for share in (0.4, 0.1, 0.2))
        wi = np.where(straight, -wo, np.where(through, wi * (1.0, 1.0, -1.0), wi))
        wo, wi = (np.where(behind, -w, w) for w in (wo, wi))
    return _float32(wo), _float32(wi)


def _direction(cosine: Floats, phi: Floats) -> Floats:
    sine = np.sqrt(1.0 - cosine * cosine)
    return np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=-1)


def _numbers(layer: PointLayer, count: int, absurd: Mask, straight: Mask, rng: Rng) -> dict[str, Floats]:
    known = MODELS[layer.model].parameters
    # All weights at their least together: the surface is black.
    nothing = rng.random(count) < 0.02
    numbers = {}
    for name in layer.shapes():
        if name not in layer.constants:
            parameter = known.get(name) or Parameter("mask", "float", 0.5)
            if parameter.kind == "normal":
                numbers[name] = _normals(count, straight, rng)
            else:
                values = _values(parameter, count, absurd, rng)
                values[nothing] = parameter.hard[0]
                numbers[name] = _within(values, *parameter.hard)
    return numbers


def _values(parameter: Parameter, count: int, absurd: Mask, rng: Rng) -> Floats:
    shape = (count,) if parameter.kind == "float" else (count, 3)
    low, high = parameter.hard
    place = rng.choice(_PLACES, shape)
    odd = (rng.random(shape) < 0.3) & (absurd if len(shape) == 1 else absurd[:, None])
    place = np.where(odd, rng.choice(_ABSURD, shape), place)
    return np.where(rng.random(shape) < 0.3, parameter.default, low + (high - low) * place)


def _normals(count: int, straight: Mask, rng: Rng) -> Floats:
    normals = rng.uniform(-1.0, 1.0, (count, 3))
    normals = np.where(rng.random((count, 1)) < 0.2, rng.choice([-1.0, 0.0, 1e-12, 1.0], (count, 3)), normals)
    normals[straight | ~normals.any(axis=-1)] = ZENITH
    return _float32(normals)


def _within(values: Floats, low: float, high: float) -> Floats:
    """Round to float32, never beyond a range."""
    rounded = _float32(values)
    inwards = np.where(rounded < low, np.inf, np.where(rounded > high, -np.inf, rounded))
    return _float32(np.nextafter(rounded.astype(np.float32), inwards.astype(np.float32)))


def _float32(values: Floats) -> Floats:
    return values.astype(np.float32).astype(np.float64)


@dataclass(frozen=True, eq=False)
class SceneCase:
    """A degenerate scene. Its picture is `gain` times that of the case `like`."""

    name: str
    asset: Asset
    light: EnvironmentMap
    like: str = ""
    gain: float = 1.0

    @property
    def white(self) -> bool:
        """Whether no pixel may be brighter than the surface's albedo."""
        return bool((self.light.radiance == 1.0).all())

    @property
    def black(self) -> bool:
        """Whether every pixel must be exactly 0."""
        return not self.light.radiance.any()


def scene_cases() -> tuple[SceneCase, ...]:
    """Return scenes with known relations of their pictures; each has one mesh, UVs ``st``, no primvars.

    They are for a look without direction or texture, because zero-area UVs give no tangent.
    """
    usual, lamp, sun = _pair(), _lamp(), _sun()
    far = (1e5, -5e4, 2e4)
    return (
        SceneCase("usual", usual, lamp),
        SceneCase("0.1 mm", _pair(scale=1e-4), lamp, "usual"),
        SceneCase("10 km", _pair(scale=1e4), lamp, "usual"),
        SceneCase("100 km away", _pair(at=far), lamp, "usual"),
        SceneCase("0.1 mm, 100 km away", _pair(scale=1e-4, at=far), lamp, "usual"),
        SceneCase("degenerate triangles", _pair(_degenerate), lamp, "usual"),
        SceneCase("zero-area UVs", _pair(_flat_uvs), lamp, "usual"),
        SceneCase("flipped normals", _pair(lambda mesh: replace(mesh, normals=-mesh.normals)), lamp, "usual"),
        SceneCase("light times 1e6", usual, _scaled(lamp, 1e6), "usual", 1e6),
        SceneCase("sun of a texel", usual, sun),
        SceneCase("sun of a texel, 1e6", usual, _scaled(sun, 1e6), "sun of a texel", 1e6),
        SceneCase("black", usual, _scaled(lamp, 0.0)),
        SceneCase("white", usual, _white()),
        *hostile_scenes(),
    )


def hostile_scenes() -> tuple[SceneCase, ...]:
    """Return scenes for every look: random shading normals and tangents, degenerate triangles, zero-area UVs."""
    hostile = _pair(lambda mesh: _anywhere(_flat_uvs(_degenerate(mesh))))
    return (
        SceneCase("normals anywhere", hostile, _white()),
        SceneCase("normals anywhere, sun of 1e6", hostile, _scaled(_sun(), 1e6)),
    )


def _pair(
    change: Callable[[Mesh], Mesh] = lambda mesh: mesh, scale: float = 1.0, at: tuple[float, ...] = (0.0, 0.0, 0.0)
) -> Asset:
    """Return two spheres that occlude and reflect each other."""
    ball = make_sphere(segments=64, rings=32)
    instances = []
    for size, place in ((1.0, (0.0, 0.0, 0.0)), (0.4, (1.2, -0.8, 0.5))):
        matrix = np.diag([size * scale] * 3 + [1.0])
        matrix[:3, 3] = np.array(at) + scale * np.array(place)
        instances.append(Instance(0, matrix))
    return make_asset("pair", [change(ball.meshes[0])], instances, ball.slots)


def _degenerate(mesh: Mesh) -> Mesh:
    """Add triangles without area: three times one corner, and an edge to and fro."""
    corners = np.arange(0, len(mesh.corner_points) - 3, 97)
    added = np.concatenate([np.stack([corners, corners + k, corners], axis=-1) for k in (0, 1)]).ravel()
    corner = np.concatenate([np.arange(len(mesh.corner_points)), added])
    faces = len(added) // 3
    return replace(
        _take(mesh, corner),
        face_sizes=np.concatenate([mesh.face_sizes, np.full(faces, 3, np.int32)]),
        face_slots=np.concatenate([mesh.face_slots, np.zeros(faces, np.int32)]),
    )


def _take(mesh: Mesh, corner: NDArray[np.intp]) -> Mesh:
    return replace(
        mesh,
        corner_points=mesh.corner_points[corner],
        normals=mesh.normals[corner],
        tangents=None if mesh.tangents is None else mesh.tangents[corner],
        uvs={name: uv[corner] for name, uv in mesh.uvs.items()},
    )


def _flat_uvs(mesh: Mesh) -> Mesh:
    """Make all UVs equal, and leave out the tangents."""
    return replace(mesh, uvs={"st": np.full_like(mesh.uvs["st"], 0.5)}, tangents=None)


def _anywhere(mesh: Mesh) -> Mesh:
    normals = np.random.default_rng(0).normal(size=mesh.normals.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return replace(mesh, normals=normals.astype(np.float32))


def _white() -> EnvironmentMap:
    return make_environment("stress", np.ones((4, 8, 3)))


def _lamp() -> EnvironmentMap:
    """Return a broad lamp in dim surroundings."""
    height, width = 16, 32
    v, u = (np.mgrid[:height, :width] + 0.5) / np.array([height, width])[:, None, None]
    beam = np.exp(6.0 * (np.cos(2.0 * np.pi * (u - 0.3)) * np.sin(np.pi * v) - 1.0))
    return make_environment("stress", 0.1 + 2.0 * beam[..., None] * (1.0, 0.8, 0.6))


def _sun() -> EnvironmentMap:
    radiance = np.zeros((64, 128, 3))
    radiance[20, 40] = (1.0, 0.8, 0.6)
    return make_environment("stress", radiance)


def _scaled(light: EnvironmentMap, gain: float) -> EnvironmentMap:
    return make_environment("stress", gain * light.radiance.astype(np.float64))
