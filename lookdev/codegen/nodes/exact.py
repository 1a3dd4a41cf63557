"""A look as nodes that sample it exactly: one direction of the BSDF a hit, sent on through a ray portal.

The portal's weight is f times the cosine over the density, so that what its ray meets, the asset again or the light, is
weighed without bias. No light is sampled, and no OSL is needed.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import Bsdf
from lookdev.brdf.frames import ZENITH, mirrored
from lookdev.brdf.lobes import Directions, Lobe
from lookdev.brdf.vectors import dot, same, scale
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.look import look_bsdf
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.frame import add_frame, frame_tree
from lookdev.codegen.nodes.inputs import bind_inputs, node_digest
from lookdev.codegen.osl.bsdf import WO
from lookdev.codegen.source import HANDEDNESS, Link, NodeSource
from lookdev.codegen.trace.graph import Graph, Node, reachable
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.errors import CodegenError
from lookdev.material import Bump, Look, Texture

# White noise of a place and a fourth number: with one that no coordinate is, the three channels never are one hash.
_SALT = 0.7548776662
# The largest float32 below 1, which a hash in float32 may round to.
_BELOW_ONE = 0.99999994


def generate_nodes_exact(look: Look, resolve: Callable[[Texture | Bump], Path], *, bounces: int) -> NodeSource:
    """Generate the nodes of a look that agree with its model exactly.

    Every ray that leaves the surface has passed a portal: `Light Path`'s transparent depth tells the world which.

    Parameters
    ----------
    look
        Constants in it are folded; lobes that vanish take their textures with them.
    resolve
        Turns a texture into its linear EXR file, a height map into that of its slopes.
    bounces
        Times that light may be reflected by the asset before it leaves it towards the camera.

    Raises
    ------
    CodegenError
        The surface is not wholly present: a ray that goes on unchanged looks like one that a portal has turned.
    """
    graph = Graph()
    inputs = Inputs(graph, resolve)
    bsdf = look_bsdf(look, inputs)
    lobes = _lobes(bsdf, symbols(graph, WO))
    (presence,) = elements_of(bsdf.presence)
    if isinstance(presence, Node) or presence < 1.0:
        raise CodegenError(
            f"{look.name}: is see-through (presence below 1), which backend 'nodes-exact' cannot tell from the"
            " background; backend 'exact' or 'nodes' would be right"
        )
    weight, wi = sampled(graph, lobes)

    axes = {name: symbols(graph, [f"{name}_{axis}" for axis in "xyz"]) for name in ("t", "b", "n", "facet")}
    world = scale(axes["t"], wi[..., 0]) + scale(axes["b"], wi[..., 1]) + scale(axes["n"], wi[..., 2])
    # The shading normal and the facet must agree on which side the light is.
    agreed = dot(world, axes["facet"]) * wi[..., 2] > 0.0
    weight = scale(weight, np.where(agreed & (symbol(graph, "depth") < bounces + 0.5), 1.0, 0.0))

    builder = TreeBuilder(look.name)
    roots = [elements_of(weight), elements_of(world)]
    names = [str(node.args[0]) for node in reachable([each for root in roots for each in root]) if node.op == "symbol"]
    attributes = bind_inputs(builder, inputs, names)
    frame = add_frame(builder)
    for name, link in (("t", frame.tangent), ("b", frame.bitangent), ("n", frame.normal)):
        builder.bind([f"{name}_{axis}" for axis in "xyz"], link)
    geometry = builder.add("NewGeometry")
    builder.bind([f"facet_{axis}" for axis in "xyz"], Link(geometry, "True Normal"))
    # The place of a hit is new for every sample of a pixel.
    place = Link(geometry, "Position")
    noise = builder.add("TexWhiteNoise", {"noise_dimensions": "4D"}, {"Vector": place, "W": _SALT})
    channels = builder.add("SeparateColor", {"mode": "RGB"}, {"Color": Link(noise, "Color")})
    builder.bind(["u1"], Link(channels, "Red"))
    builder.bind(["u2"], Link(channels, "Green"))
    builder.bind(["depth"], Link(builder.add("LightPath"), "Transparent Depth"))

    builder.prepare(roots)
    color, direction = (builder.vector(root) for root in roots)
    portal = builder.add("BsdfRayPortal", inputs={"Color": color, "Direction": direction})
    builder.add("OutputMaterial", inputs={"Surface": Link(portal, "BSDF")})
    leaning = any(binding.attribute == HANDEDNESS for binding in attributes)
    trees = (frame_tree(leaning=leaning), builder.tree())
    transmits = any(lobe.transmits for lobe in lobes)
    return NodeSource(look.name, trees, attributes, node_digest(trees, attributes), True, transmits)


def _lobes(bsdf: Bsdf, wo: Any) -> list[Lobe]:
    """Return the lobes whose share does not fold to zero."""
    shares = [(lobe, *elements_of(lobe.share)) for lobe in bsdf.lobes(wo)]
    return [lobe for lobe, share in shares if isinstance(share, Node) or share > 0.0]


def sampled(graph: Graph, lobes: list[Lobe]) -> tuple[Any, Any]:
    """Trace one sample of lobes, at the symbols ``wo_x wo_y wo_z u1 u2``.

    Returns
    -------
    weight : (3,)
        f times the cosine over the density of all lobes; 0 where no lobe sends light.
    wi : (3,)
        The direction drawn, in the surface's frame.
    """
    if not lobes:
        return np.zeros(3), ZENITH
    wo = symbols(graph, WO)
    numbers: Any = symbols(graph, ("u1", "u2"))
    u1, u2 = np.minimum(numbers, _BELOW_ONE)
    total = sum(lobe.share for lobe in lobes)
    place = u1 * total
    # From the last to the first: a number belongs to the first lobe whose share it does not pass.
    wi: Any = None
    for index, lobe in reversed(list(enumerate(lobes))):
        before = sum(each.share for each in lobes[:index])
        # Rounding may carry the number to the very end of the share, which stands for 1.
        stretched = np.clip((place - before) / lobe.share, 0.0, _BELOW_ONE) if len(lobes) > 1 else u1
        drawn = lobe.draw(stretched, u2)
        wi = drawn if wi is None else np.where(np.expand_dims(place < before + lobe.share, -1), drawn, wi)

    f: Any = np.zeros(3)
    density: Any = np.array(0.0)
    front, back = wi[..., 2] > 0.0, wi[..., 2] < 0.0
    # Where a lobe sends no light it still has a value, which counts 0 times: it must be finite.
    upper = np.stack([wi[..., 0], wi[..., 1], np.absolute(wi[..., 2])], axis=-1)
    for lobe in lobes:
        directions = Directions.of(*lobe.pair(wo, mirrored(upper) if lobe.transmits else upper))
        valid = back if lobe.transmits else front
        if not same(lobe.normal, ZENITH):
            valid = valid & (directions.cos_theta_i > 0.0) & (directions.cos_theta_o > 0.0)
        f = f + scale(lobe.evaluate(directions), np.where(valid, directions.cos_theta_i, 0.0))
        density = density + np.where(valid, lobe.pdf(directions) * lobe.share, 0.0)
    return scale(f, total / density), wi
