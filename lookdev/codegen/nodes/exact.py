"""Write a look as nodes that sample its model exactly, for backend ``nodes-exact``, which needs no OSL.

At each hit, the node Ray Portal sends the ray on along one direction that is drawn from the BSDF. The weight of the
direction is f times the cosine, divided by the pdf. This estimator is unbiased, whether the ray then meets the asset or
a light. Directions are not drawn from the light.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from lookdev.brdf import Array, Lobe
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.mixture import ONE_MINUS_EPSILON
from lookdev.brdf.vectors import dot, scale
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.frame import add_frame, frame_tree
from lookdev.codegen.nodes.inputs import bind_inputs, node_digest
from lookdev.codegen.nodes.lift import add_lift
from lookdev.codegen.source import HANDEDNESS, TANGENT_BINDING, NodeLink, NodeSource
from lookdev.codegen.trace.azimuth import depends_on_tangent
from lookdev.codegen.trace.graph import Graph, GraphNode, Symbol, reachable_nodes
from lookdev.codegen.trace.lobes import assume_positive, present_lobes, trace_mixture
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols
from lookdev.errors import CodegenError
from lookdev.material import Bump, Look, Texture
from lookdev.material.values import look_bsdf

# The fourth coordinate of the white noise, an arbitrary number. The first three are the position. Each channel of the
# noise hashes the coordinates in another order: if two coordinates were equal, two channels could be equal.
_NOISE_SEED = 0.7548776662


def generate_nodes_exact(look: Look, resolve: Callable[[Texture | Bump], Path], *, bounces: int) -> NodeSource:
    """Generate the nodes that sample a look; a path ends after `bounces` portals.

    `resolve` is as in `lookdev.codegen.inputs.SymbolicSurface`. Every ray that leaves the surface has passed a portal,
    which Cycles counts in the transparent depth of the node Light Path. By this number, the nodes of the world
    distinguish the rays that have left a surface from camera rays.

    Raises
    ------
    CodegenError
        The surface is see-through. A ray that passes it unchanged would increase the transparent depth, too.
    """
    graph = Graph()
    inputs = SymbolicSurface(graph, resolve)
    bsdf = look_bsdf(look, inputs)
    lobes = present_lobes(graph, bsdf)
    (presence,) = elements_of(bsdf.presence)
    if isinstance(presence, GraphNode) or presence < 1.0:
        raise CodegenError(
            f"{look.name}: is see-through (presence below 1), which backend 'nodes-exact' cannot distinguish from the"
            " background; backend 'exact' or 'nodes' would be right"
        )
    weight, wi = trace_sample(graph, lobes)

    axes = {name: symbols(graph, [f"{name}_{axis}" for axis in "xyz"]) for name in ("t", "b", "n", "facet")}
    world = scale(axes["t"], wi[..., 0]) + scale(axes["b"], wi[..., 1]) + scale(axes["n"], wi[..., 2])
    # A direction is valid if it is above both the facet and the shading normal's horizon, or below both.
    facet_cosine = dot(world, axes["facet"])
    valid = facet_cosine * wi[..., 2] > 0.0
    transmits = any(lobe.transmits for lobe in lobes)
    if not transmits and any(lobe.crosses_surface for lobe in lobes):
        valid = valid & (facet_cosine > 0.0)
    weight = scale(weight, np.where(valid & (symbol(graph, "depth") < bounces + 0.5), 1.0, 0.0))

    position = symbols(graph, [f"place_{axis}" for axis in "xyz"])
    lift = symbol(graph, "lift")
    ray_start = position + scale(axes["facet"], np.where(facet_cosine < 0.0, -1.0, 1.0) * lift)

    builder = TreeBuilder(look.name)
    roots = [elements_of(value) for value in (weight, world, ray_start)]
    names = [
        node.name for node in reachable_nodes([value for root in roots for value in root]) if isinstance(node, Symbol)
    ]
    reads_tangent = depends_on_tangent(graph, lobes)
    attributes = (*bind_inputs(builder, inputs, names), *[TANGENT_BINDING] * reads_tangent)
    for name, link in add_frame(builder).items():
        builder.bind([f"{name[0]}_{axis}" for axis in "xyz"], link)
    geometry = builder.add("NewGeometry")
    builder.bind([f"facet_{axis}" for axis in "xyz"], NodeLink(geometry, "True Normal"))
    builder.bind([f"place_{axis}" for axis in "xyz"], NodeLink(geometry, "Position"))
    builder.bind(["lift"], add_lift(builder))
    # u1 and u2 are white noise at the shading point. They are random because each sample of a pixel hits another point.
    noise = builder.add(
        "TexWhiteNoise", {"noise_dimensions": "4D"}, {"Vector": NodeLink(geometry, "Position"), "W": _NOISE_SEED}
    )
    channels = builder.add("SeparateColor", {"mode": "RGB"}, {"Color": NodeLink(noise, "Color")})
    builder.bind(["u1"], NodeLink(channels, "Red"))
    builder.bind(["u2"], NodeLink(channels, "Green"))
    builder.bind(["depth"], NodeLink(builder.add("LightPath"), "Transparent Depth"))

    builder.plan_vectors(roots)
    color, direction, start = (builder.vector(root) for root in roots)
    portal = builder.add("BsdfRayPortal", inputs={"Color": color, "Position": start, "Direction": direction})
    builder.add("OutputMaterial", inputs={"Surface": NodeLink(portal, "BSDF")})
    bends_normals = any(binding.attribute == HANDEDNESS for binding in attributes)
    trees = (frame_tree(reads_tangent=reads_tangent, bends_normals=bends_normals), builder.tree())
    return NodeSource(look.name, trees, attributes, node_digest(trees, attributes), True, transmits)


def trace_sample(graph: Graph, lobes: Sequence[Lobe]) -> tuple[Array, Array]:
    """Return the weight (3,) and the direction (3,) of one sample of lobes, as functions of symbols.

    The symbols are ``wo_x wo_y wo_z``, the direction to the viewer, and the random numbers ``u1 u2``. Directions are in
    the shading frame. The weight is f times the cosine, divided by the density; both are summed over all lobes. The
    weight is 0 where no lobe scatters.
    """
    if not lobes:
        return np.zeros(3), ZENITH
    mixture = trace_mixture(graph, lobes)
    assume_positive(graph, mixture.wo[..., 2])
    u1, u2 = np.minimum(symbols(graph, ("u1", "u2")), ONE_MINUS_EPSILON)
    # The result is the direction of the first lobe whose `is_below_end` is true: u1 is in the range of this lobe.
    *others, last = mixture.choices(u1)
    wi = last.lobe.draw(last.remapped, u2)
    for choice in reversed(others):
        wi = np.where(np.expand_dims(choice.is_below_end, -1), choice.lobe.draw(choice.remapped, u2), wi)
    value, density = mixture.response(wi)
    return scale(value, 1.0 / density), wi
