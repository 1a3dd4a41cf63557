"""Which looks need the direction of a tangent: those that change when the frame rotates, and no others."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from layers import DOME
from random_parameters import EVERY, VARIANTS, directions, near_the_mirror_image, random_parameters

from lookdev.brdf import MODELS
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.lobes import Bsdf
from lookdev.brdf.mixture import evaluate_cosine
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import TANGENT, GeneratedSource
from lookdev.codegen.trace.azimuth import depends_on_tangent
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import present_lobes
from lookdev.codegen.trace.symbolic import symbol, symbols
from lookdev.material import Bump, Layer, Look, Primvar, Texture
from lookdev.rendering.backends import BACKENDS
from lookdev.scene import Sampling


def one_point(rng: np.random.Generator, model: str, tokens: dict[str, str], leaning: float) -> dict[str, Any]:
    parameters = random_parameters(rng, model, tokens, 1, leaning)
    return {name: value if isinstance(value, str) else value[0] for name, value in parameters.items()}


def changes(bsdf: Bsdf, rng: np.random.Generator) -> bool:
    """Return whether f at random directions changes when these rotate about the normal."""
    wo = directions(rng, 400)
    wi = near_the_mirror_image(rng, wo)
    wi[::2, 2] *= -1.0
    s, c = np.sin(0.7), np.cos(0.7)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    f, rotated_f = evaluate_cosine(bsdf, wo, wi), evaluate_cosine(bsdf, wo @ rotation.T, wi @ rotation.T)
    # Narrow lobes magnify the roundings of a direction by 1 / alpha^2, 1e6 at most, and by more off their peak.
    return bool((np.abs(f - rotated_f) > 1e-6 * np.abs(f).max(axis=0) + 1e-3 * np.abs(f)).any())


@pytest.mark.parametrize(
    ("model", "tokens", "draws"),
    [
        *((model, tokens, 8) for model, tokens in dict(VARIANTS).items()),  # the last of a model, with all its options
        *(pytest.param(*variant, 120, marks=pytest.mark.proof) for variant in VARIANTS),
    ],
    ids=str,
)
def test_a_traced_model_needs_a_tangent_where_turning_it_shows(model: str, tokens: dict[str, str], draws: int) -> None:
    """Half of the draws have upright normals, in the others three normals of ten lean."""
    rng = np.random.default_rng(5)
    results = []
    for number in range(draws):
        values = one_point(rng, model, tokens, 0.3 * (number % 2))
        graph, bsdf = Graph(), MODELS[model].bsdf(values)
        results.append((depends_on_tangent(graph, present_lobes(graph, bsdf)), changes(bsdf, rng)))
    needed, visible = np.array(results).T
    # Lobes too faint or too narrow for the random directions keep their tangent; no visible change loses it.
    assert not (visible & ~needed).any()
    assert (needed == visible).mean() > 0.8


def _round(values: dict[str, Any]) -> dict[str, Any]:
    """Return coefficients of Lafortune's lobes that are the same along x and y."""
    coefficients = {name: value for name, value in values.items() if name.startswith("coefficients")}
    return {
        name: np.stack([value[..., 0], value[..., 0], value[..., 2]], axis=-1) for name, value in coefficients.items()
    }


# Parameters that make anisotropic models isotropic.
ISOTROPIC: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "disney": lambda values: {"anisotropic": np.array(0.0)},
    "ward": lambda values: {"alphaY": values["alphaX"]},
    "ashikhmin-shirley": lambda values: {"exponentV": values["exponentU"]},
    "lafortune": _round,
}


@EVERY
def test_a_parameter_that_varies_is_taken_for_any_value(model: str, tokens: dict[str, str]) -> None:
    graph = Graph()
    values: dict[str, Any] = {}
    for name, parameter in MODELS[model].parameters.items():
        match parameter.kind:
            case "token":
                values[name] = tokens.get(name, parameter.default)
            case "normal":
                values[name] = ZENITH
            case "float":
                values[name] = symbol(graph, name)
            case _:
                values[name] = symbols(graph, [f"{name}{i}" for i in range(3)])
    directed = depends_on_tangent(graph, present_lobes(graph, MODELS[model].bsdf(values)))
    assert directed == (model in ISOTROPIC)
    if directed:
        values |= ISOTROPIC[model](values)
        assert not depends_on_tangent(graph, present_lobes(graph, MODELS[model].bsdf(values)))


def disney(mask: Any = 1.0, **inputs: Any) -> Layer:
    return Layer("layer", "disney", {"baseColor": (0.5, 0.4, 0.3), **inputs}, mask)


def pixar(mode: str = "over", **inputs: Any) -> Layer:
    return Layer("layer", "pixar", {"surfaceColor": (0.5, 0.4, 0.3), **inputs}, 1.0, mode)  # type: ignore[arg-type]


MAPPED = Texture(Path("normal.exr"), "rgb", "raw")
WEAR = Primvar("wear", 0.5)

PLAIN = {
    "plain": (disney(),),
    "varying": (disney(roughness=WEAR, metallic=Primvar("rust", 0.2), clearcoat=0.5, sheen=0.5),),
    "upright": (disney(normal=(0.0, 0.0, 1.0), anisotropic=0.0),),
    "polished": (disney(anisotropic=0.5, roughness=0.0),),
    "glass": (pixar(roughness=0.2, clear=0.8, back=0.3),),
    "lacquer": (pixar(roughness=0.7, back=0.3), pixar("transmit", roughness=0.2, clear=0.9)),
    "two models": (disney(), pixar(roughness=0.4)),
}
DIRECTED = {
    "brushed": (disney(anisotropic=0.5, metallic=1.0),),
    "brushed in places": (disney(anisotropic=WEAR, metallic=1.0),),
    "brushed below": (disney(anisotropic=0.5), disney(WEAR, roughness=0.8)),
    "normal-mapped": (disney(normal=MAPPED),),
    "leaning": (disney(normal=(0.2, 0.3, 1.0)),),
    "embossed": (pixar(roughness=0.4, highlightNormal=Bump(MAPPED, 0.1)),),
}


@pytest.mark.parametrize("backend", ["exact", "nodes", "nodes-exact"])
@pytest.mark.parametrize("name", [*PLAIN, *DIRECTED])
def test_a_source_reads_the_tangents_where_its_look_needs_them(
    backend: str, name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    MAPPED.file.write_bytes(b"pixels")
    look = Look("look", (PLAIN | DIRECTED)[name])
    setting = SourceSetting((DOME,), (8, 8), Sampling(), resolve=lambda image: MAPPED.file.resolve())
    source: GeneratedSource = BACKENDS[backend].generate(look, setting)
    # Stand-ins of transmitting lobes have a normal computed from all axes; that it does not rotate is not detected.
    needs = name in DIRECTED or (backend, name) == ("nodes", "glass")
    assert (TANGENT in {binding.attribute for binding in source.attributes}) == needs
