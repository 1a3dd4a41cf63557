"""Smits' "Layering": the result of each pair of lobes, and metals over metals."""

from typing import Any

import numpy as np
import pytest
from random_parameters import directions

from lookdev.brdf import StackLayer, complete_parameters, evaluate, stack_bsdf
from lookdev.brdf.pixar.layering import combine_partitions
from lookdev.brdf.pixar.partition import REFLECTED_LOBES, TRANSMITTED_LOBES, Partition, layer_partition

_COUNT = 500
_WO = np.array([0.6, 0.0, 0.8])
_LOBES = (*REFLECTED_LOBES, *TRANSMITTED_LOBES)
# The document's table: the lobe of the layer above that meets a lobe of the layer beneath, the lobe that comes out, and
# whose cone it has, of the two or the larger; a diffuse lobe has none.
_REFLECTED = [
    ("refraction", "reflection", "reflection", "larger"),
    ("refraction", "specular", "specular", "beneath"),
    ("refraction", "diffuse", "diffuse", None),
    ("specularTransmission", "reflection", "specular", "above"),
    ("specularTransmission", "specular", "specular", "larger"),
    ("specularTransmission", "diffuse", "diffuse", None),
    ("diffuseTransmission", "reflection", "diffuse", None),
    ("diffuseTransmission", "specular", "diffuse", None),
    ("diffuseTransmission", "diffuse", "diffuse", None),
]
# The nine pairs that the document does not print: the same rule on the other side.
_OTHER_SIDE = dict(zip(REFLECTED_LOBES, TRANSMITTED_LOBES, strict=True))
_TRANSMITTED = [(above, _OTHER_SIDE[beneath], _OTHER_SIDE[out], cone) for above, beneath, out, cone in _REFLECTED]


def _parameters(**inputs: Any) -> dict[str, Any]:
    return complete_parameters("pixar", inputs)


def _layered(above: Partition, below: Partition, mask: Any, mode: Any) -> Partition:
    return combine_partitions([(below, 1.0, "over"), (above, mask, mode)])


def _with_only(lobe: str, **inputs: Any) -> dict[str, Any]:
    """Return parameters of a layer whose other lobes are scaled to 0."""
    return _parameters(clear=0.6, back=0.4, **inputs, **{f"{name}Scale": 0.0 for name in _LOBES if name != lobe})


# The roughness of the layer above, and so its cone, is larger or smaller than that of the layer beneath.
@pytest.mark.parametrize("roughness", [(0.4, 0.2), (0.2, 0.4)])
@pytest.mark.parametrize(("incoming", "lobe", "out", "cone"), [*_REFLECTED, *_TRANSMITTED])
def test_the_tables(incoming: str, lobe: str, out: str, cone: str | None, roughness: tuple[float, float]) -> None:
    top = _with_only(incoming, surfaceColor=(0.9, 0.5, 0.2), ior=1.3, roughness=roughness[0])
    bottom = _with_only(lobe, surfaceColor=(0.3, 0.6, 0.8), metallic=0.4, ior=1.7, roughness=roughness[1])
    above, beneath = layer_partition(top, _WO), layer_partition(bottom, _WO)
    result = _layered(above, beneath, 1.0, "transmit").terms
    for name, term in result.items():
        for weight in ("normal", "grazing"):
            product = getattr(above.terms[incoming], weight) * getattr(beneath.terms[lobe], weight)
            np.testing.assert_allclose(getattr(term, weight), product if name == out else 0.0, rtol=1e-15)
    assert result[out].normal.min() > 0.0
    if cone:
        cones = {"above": above.terms[incoming].cone, "beneath": beneath.terms[lobe].cone}
        cones["larger"] = max(cones.values())
        assert result[out].cone == pytest.approx(cones[cone], rel=1e-15)
        # The layer beneath "replaces the direction", and bends it.
        assert result[out].ior_minus_one == pytest.approx(0.7 if out in TRANSMITTED_LOBES else 0.0, rel=1e-15)
    # The stack of the two has that lobe, and no other.
    stack = stack_bsdf([StackLayer("pixar", bottom), StackLayer("pixar", top, 1.0, "transmit")])
    assert [lobe.name for lobe in stack.lobes(_WO) if lobe.share > 0.0] == [out]


def test_the_tables_are_whole() -> None:
    assert {pair[:2] for pair in (*_REFLECTED, *_TRANSMITTED)} == {(a, b) for a in TRANSMITTED_LOBES for b in _LOBES}
    # "The specular contribution ... is the sum of three interactions, and the diffuse ... of five".
    for side, table in ((REFLECTED_LOBES, _REFLECTED), (TRANSMITTED_LOBES, _TRANSMITTED)):
        outcomes = [out for _, _, out, _ in table]
        assert [outcomes.count(name) for name in side] == [1, 3, 5]


_INDICES = {"gold": ((0.1, 0.4, 1.6), (10.0, 2.3, 1.7)), "glass": ((1.5, 1.6, 1.7), (0.0, 0.0, 0.0))}


def _exact(name: str, **inputs: Any) -> dict[str, Any]:
    eta, k = _INDICES[name]
    return _parameters(metallic=1.0, fresnel="conductor", eta=eta, k=k, **inputs)


def test_layers_of_different_metals_are_mixed() -> None:
    rng = np.random.default_rng(35)
    wo = directions(rng, _COUNT)
    wi = wo * [-1.0, -1.0, 1.0] + rng.normal(0.0, 0.1, wo.shape)
    wi /= np.linalg.norm(wi, axis=-1, keepdims=True)
    layers = [_exact("gold"), _parameters(metallic=1.0), _exact("glass"), _exact("gold")]
    stack = stack_bsdf([StackLayer("pixar", layer, 0.4) for layer in layers])
    parts = (evaluate(stack_bsdf([StackLayer("pixar", layer)]), wo, wi) for layer in layers)
    # All cones are equal.
    expected = sum(w * f for w, f in zip((0.216, 0.144, 0.24, 0.4), parts, strict=True))
    np.testing.assert_allclose(evaluate(stack, wo, wi), expected, rtol=1e-11, atol=1e-30)
    # Equal metals are merged.
    partition = combine_partitions([(layer_partition(layer, wo), 0.4, "over") for layer in layers])
    assert [len(term.metals) for term in partition.terms.values()] == [2, 2, 0, 0, 0, 0]


def test_what_a_layer_transmits_meets_the_curve_of_a_metal() -> None:
    rng = np.random.default_rng(36)
    wo = directions(rng, _COUNT)
    inputs = _parameters(roughness=0.3, clear=0.7, back=0.5), _exact("gold", roughness=0.2)
    lacquer, metal = (layer_partition(layer, wo) for layer in inputs)
    result = _layered(lacquer, metal, 1.0, "transmit")
    narrow, broad, diffuse = (lacquer.terms[name] for name in TRANSMITTED_LOBES)
    (mirror,), (glossy,) = (metal.terms[name].metals for name in REFLECTED_LOBES[:2])
    for kind in ("normal", "grazing"):
        a, b, c, m, g = (getattr(term, kind) for term in (narrow, broad, diffuse, mirror, glossy))
        # The table, where every reflection of the metal has the metal's curve.
        expected = {"reflection": a * m, "specular": a * g + b * (m + g), "diffuse": c * (m + g)}
        for name in REFLECTED_LOBES:
            (sole,) = result.terms[name].metals
            np.testing.assert_allclose(getattr(sole, kind), expected[name], rtol=1e-12)
            np.testing.assert_array_equal((sole.eta, sole.k), _INDICES["gold"])
    assert all(not result.terms[name].metals for name in TRANSMITTED_LOBES)
