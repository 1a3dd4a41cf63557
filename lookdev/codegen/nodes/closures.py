"""Add the nodes of Cycles' closures that approximate the lobes of a BSDF, for the looks of backend ``nodes``.

`lookdev.closures` chooses the closures of a lobe; this module writes them as shader nodes.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from lookdev.brdf import Array, Bsdf, Real
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.vectors import are_equal, scale
from lookdev.closures import Closure, lobe_closures
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.group import add_value, bind_symbols
from lookdev.codegen.source import NodeLink, SocketValue
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WO, present_lobes
from lookdev.codegen.trace.symbolic import elements_of, symbols

SocketInputs: TypeAlias = dict[str, SocketValue | NodeLink]
"""The inputs of a node, constants or links, by the identifiers of its sockets."""

_X = np.array([1.0, 0.0, 0.0])


def add_closures(graph: Graph, builder: TreeBuilder, bsdf: Bsdf, frame: Array) -> tuple[NodeLink | None, bool]:
    """Add the closures of a BSDF, traced in `graph`, to a tree; return their sum, and whether one of them transmits.

    The sum is an output, or None if there are no closures. The rows of `frame` (3, 3) are tangent, bitangent and normal
    in world space. The symbols of `frame`, and the symbols `WO`, must be bound in the tree.
    """
    lobes = present_lobes(graph, bsdf)
    closures = _merge_closures(
        (closure, lobe.name) for lobe in lobes for closure in lobe_closures(lobe, symbols(graph, WO))
    )
    vectors = [
        vector
        for closure, _ in closures
        for vector in (closure.weight, closure.f0, closure.eta, closure.k, _to_world(frame, closure.frame.normal))
    ]
    builder.plan_vectors(elements_of(vector) for vector in vectors)
    total: NodeLink | None = None
    for closure, label in closures:
        total = add_shaders(builder, total, _add_closure(graph, builder, closure, frame, label))
    return total, any(closure.transmits for closure, _ in closures)


def add_shaders(builder: TreeBuilder, a: NodeLink | None, b: NodeLink | None) -> NodeLink | None:
    """Add a node that sums two shaders, and return its output. None stands for a black shader."""
    if a is None or b is None:
        return b if a is None else a
    return NodeLink(builder.add("AddShader", inputs={"Shader": a, "Shader_001": b}), "Shader")


def scale_shader(builder: TreeBuilder, shader: NodeLink | None, factor: Real) -> NodeLink | None:
    """Add a node that multiplies a shader by a factor from 0 to 1, and return the node's output.

    The node mixes the shader with black. None stands for a black shader.
    """
    if shader is None or are_equal(factor, 0.0):
        return None
    if are_equal(factor, 1.0):
        return shader
    return NodeLink(
        builder.add("MixShader", inputs={"Fac": add_value(builder, factor), "Shader_001": shader}), "Shader"
    )


def add_transparent(builder: TreeBuilder, shader: NodeLink | None, presence: Real) -> NodeLink | None:
    """Add a transparent shader of weight 1 - presence to a shader, and return the sum.

    Rays pass unchanged where the surface is absent.
    """
    absence = 1.0 - presence
    if are_equal(absence, 0.0):
        return shader
    amount = builder.vector(elements_of(absence) * 3)
    return add_shaders(builder, shader, NodeLink(builder.add("BsdfTransparent", inputs={"Color": amount}), "BSDF"))


def _merge_closures(closures: Iterable[tuple[Closure, str]]) -> list[tuple[Closure, str]]:
    """Drop closures of weight 0, sum closures that differ only in weight, and return the closures with their labels.

    The labels are the names of lobes.
    """
    merged: dict[tuple[object, ...], tuple[Closure, str]] = {}
    for closure, label in closures:
        if are_equal(closure.weight, 0.0):
            continue
        values_without_weight = {**vars(closure), "weight": 0.0, "frame": closure.frame.normal}
        key = tuple(element for value in values_without_weight.values() for element in elements_of(value))
        if key in merged:
            first, labels = merged[key]
            closure = replace(first, weight=first.weight + closure.weight)
            label = labels if label in labels.split(", ") else f"{labels}, {label}"
        merged[key] = closure, label
    return list(merged.values())


def _add_closure(graph: Graph, builder: TreeBuilder, closure: Closure, frame: Array, label: str) -> NodeLink | None:
    """Add the node of a closure, and return its output."""
    inputs: SocketInputs = {"Normal": add_value(builder, _to_world(frame, closure.frame.normal))}
    properties = {}
    color = add_value(builder, closure.weight)
    match closure.kind:
        case "metal" | "conductor":
            return _add_metal(builder, closure, frame, label, inputs)
        case "sheen":
            return _add_sheen(builder, color, label, inputs)
        case "rough_diffuse":
            inputs |= {"Color": add_value(builder, closure.f0), "Roughness": add_value(builder, closure.roughness)}
            shader = NodeLink(builder.add("BsdfDiffuse", inputs=inputs, label=label), "BSDF")
            return scale_shader(builder, shader, closure.weight[..., 0])  # the node has no socket for a weight
        case "diffuse":
            node_type = "BsdfDiffuse"
            inputs["Roughness"] = 0.0
        case "translucent":
            node_type = "BsdfTranslucent"
        case "ggx_refraction" | "beckmann_refraction":
            node_type = "BsdfRefraction"
            properties["distribution"] = closure.kind.removesuffix("_refraction").upper()
            inputs["Roughness"] = add_value(builder, np.sqrt(closure.alpha_x))
            # On the back of a surface, Cycles inverts the index of refraction, as inside a solid. This lobe belongs to
            # a thin surface, which refracts in the same way from both sides, so the index is inverted once more.
            geometry = NodeLink(builder.add("NewGeometry"), "Backfacing")
            behind = bind_symbols(graph, builder, "frame.behind", geometry, vector=False)
            inputs["IOR"] = add_value(builder, np.where(behind > 0.5, 1.0 / closure.ior, closure.ior))
        case "ggx" | "beckmann":
            node_type = "BsdfAnisotropic"
            properties["distribution"] = closure.kind.upper()
            inputs |= _glossy_inputs(builder, closure, frame)
    return NodeLink(builder.add(node_type, properties, {"Color": color} | inputs, label), "BSDF")


def _add_metal(
    builder: TreeBuilder, closure: Closure, frame: Array, label: str, inputs: SocketInputs
) -> NodeLink | None:
    """Add the node of a closure ``"metal"`` or ``"conductor"``, and return its output.

    The node has no socket for a weight, so a mix with black scales its shader.
    """
    exact = closure.kind == "conductor"
    if exact:
        inputs |= {"IOR": add_value(builder, closure.eta), "Extinction": add_value(builder, closure.k)}
    else:
        inputs |= {"Base Color": add_value(builder, closure.f0), "Edge Tint": (1.0, 1.0, 1.0)}
    inputs |= _glossy_inputs(builder, closure, frame)
    properties = {"distribution": "GGX", "fresnel_type": "PHYSICAL_CONDUCTOR" if exact else "F82"}
    shader = NodeLink(builder.add("BsdfMetallic", properties, inputs, label), "BSDF")
    return scale_shader(builder, shader, closure.weight[..., 0])


def _add_sheen(builder: TreeBuilder, color: SocketValue | NodeLink, label: str, inputs: SocketInputs) -> NodeLink:
    """Add sheen as a Principled BSDF, a metal under a coat of the tint `color`, and return its output.

    The metal's base colour is black. The coat's index of refraction is 1, so the coat does not reflect. The coat's
    normal is the direction to the viewer: along its normal, a coat has exactly its tint.
    """
    inputs |= {"Base Color": (0.0, 0.0, 0.0), "Metallic": 1.0, "Roughness": 1.0, "Specular Tint": (1.0, 1.0, 1.0)}
    inputs |= {"Coat Weight": 1.0, "Coat Roughness": 1.0, "Coat IOR": 1.0, "Coat Tint": color}
    inputs["Coat Normal"] = NodeLink(builder.add("NewGeometry"), "Incoming")
    return NodeLink(builder.add("BsdfPrincipled", {"distribution": "GGX"}, inputs, label), "BSDF")


def _glossy_inputs(builder: TreeBuilder, closure: Closure, frame: Array) -> SocketInputs:
    """Return the inputs of a glossy closure's sockets for roughness r, anisotropy a and tangent.

    Cycles computes alpha_x = r^2 / s and alpha_y = r^2 s, where s depends on a. For a metal, s^2 = 1 - 0.9 a,
    as in Disney's BRDF. For other closures, s = 1 + a, with a negative a.
    """
    x, y = closure.alpha_x, closure.alpha_y
    if are_equal(x, y):
        return {"Roughness": add_value(builder, np.sqrt(x))}
    s_squared = y / x
    anisotropy = (1.0 - s_squared) * (1.0 / 0.9) if closure.kind in ("metal", "conductor") else np.sqrt(s_squared) - 1.0
    return {
        "Roughness": add_value(builder, np.sqrt(np.sqrt(x * y))),
        "Anisotropy": add_value(builder, anisotropy),
        "Tangent": add_value(builder, _to_world(frame, closure.frame.from_local(_X))),
    }


def _to_world(frame: Array, w: Array) -> Array:
    """Return the world direction (3,) of w (3,), whose components are along the axes of `frame` (3, 3)."""
    if are_equal(w, ZENITH):
        return frame[2]
    return scale(frame[0], w[0]) + scale(frame[1], w[1]) + scale(frame[2], w[2])
