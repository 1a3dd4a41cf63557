"""Generate the program of a look, the operations of its traced graph, for Mitsuba and for pages in the browser.

Mitsuba traces the operations with its own compiler, Dr.Jit, without source text. `codegen.glsl` writes them as text.

- Jakob, W., Speierer, S., Roussel, N. and Vicini, D. 2022. Dr.Jit: A Just-In-Time Compiler for Differentiable
  Rendering. ACM Transactions on Graphics 41(4).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats
from lookdev.brdf import MODELS, Array, Bsdf, Real, StackLayer, stack_bsdf
from lookdev.brdf.mixture import Mixture
from lookdev.brdf.table import NumberTable
from lookdev.brdf.vectors import Parameters
from lookdev.cache import Content, cached_file
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.program.writer import ProgramWriter
from lookdev.codegen.source import HANDEDNESS, LOBE_GROUPS, TANGENT_BINDING, ProgramSource
from lookdev.codegen.trace.azimuth import depends_on_tangent
from lookdev.codegen.trace.derivatives import derivatives
from lookdev.codegen.trace.graph import Graph, GraphNode, Scalar
from lookdev.codegen.trace.lobes import (
    WI,
    WO,
    assume_positive,
    continuous_lobes,
    folded_lobe_count,
    lobe_parts,
    present_deltas,
    recorded_group,
    trace_features,
)
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols, uniforms, vector_symbols
from lookdev.errors import CodegenError
from lookdev.material import Bump, Look, Texture
from lookdev.material.change import is_live
from lookdev.material.values import look_layers
from lookdev.scene.shading import shading_frame
from lookdev.space import REC709, Space, matrix_from_rec709

LivePredicate = Callable[[int, str], bool]
"""A function that returns whether a constant is live: its value can change while the program stays the same.

The arguments are the index of the constant's layer, counted from the base, and its parameter or ``"mask"``.
"""

# The types of a layer's values that are constants. Other values are symbols or tokens.
_CONSTANT_TYPES = (np.ndarray, float)


def generate_program(
    look: Look,
    resolve: Callable[[Texture | Bump], Path],
    *,
    shadows: bool = True,
    features: bool = False,
    space: Space = REC709,
    live: LivePredicate = lambda number, name: False,
) -> ProgramSource:
    """Generate the program of a look.

    Constants are folded, and become uniforms of the program, so that looks that differ in numbers alone have the same
    operations. A fit makes some inputs live by `lookdev.material.change.look_with_live_inputs`. The program then has
    derivatives with respect to these inputs.

    Parameters
    ----------
    look
        The look.
    resolve
        A function that returns the linear EXR file of a texture, or the file of the slopes of a height map.
    shadows
        Whether rays are traced from the shading point.
    features
        Whether the program has outputs that guide a denoiser.
    space
        The colour space of the light.
    live
        Returns whether a constant is live. Live constants do not fold, but are symbols named by `live_name`. A colour
        is three symbols, with ``[0]`` to ``[2]`` appended to the name.
    """
    graph = Graph()
    inputs = SymbolicSurface(graph, resolve)
    bsdf = trace_look(look, inputs, space, live)
    lobes, deltas = continuous_lobes(graph, bsdf), present_deltas(graph, bsdf)
    presence = elements_of(bsdf.presence)[0]
    see_through = isinstance(presence, GraphNode) or presence < 1.0
    mixture = Mixture(lobes, symbols(graph, WO))
    # The shading frame is bent until the viewer is above its horizon, so wo_z is positive. OSL also assumes that the
    # shares of lobes are positive, but a program cannot: it has no branches, so the code of a lobe also runs where the
    # lobe is absent.
    assume_positive(graph, mixture.wo[..., 2])
    value, pdf = mixture.response(symbols(graph, WI))
    outputs: dict[str, Real | list[Scalar]] = {"value": value, "pdf": pdf}
    outputs["wi"] = mixture.draw(symbol(graph, "u1"), symbol(graph, "u2"))
    parts = _group_parts(mixture, symbols(graph, WI))
    outputs["diffuse"] = sum((diffuse for _, diffuse in parts.values()), np.zeros(3))
    for group, (group_value, diffuse) in parts.items():
        outputs[f"of_{group}"] = [*elements_of(group_value), *elements_of(diffuse)]
    for number, delta in enumerate(deltas):
        group_number = float(LOBE_GROUPS.index(recorded_group(delta)))
        outputs[f"delta{number}"] = [*elements_of(delta.direction), *elements_of(delta.value), group_number]
    present = {*parts, *map(recorded_group, deltas)}
    if see_through:
        outputs["presence"] = bsdf.presence
    if features:
        outputs["albedo"], outputs["bent"] = trace_features(mixture, deltas)
    outputs |= _derivatives(graph, look.name, inputs, outputs)
    reads_tangent = depends_on_tangent(graph, lobes)
    writer = ProgramWriter()
    for name, result in outputs.items():
        writer.add(name, elements_of(result))
    attributes = inputs.attributes_read_by(writer.symbols)
    bends_normals = any(binding.attribute == HANDEDNESS for binding in attributes)
    for name, result in _frame_outputs(graph, reads_tangent, bends_normals).items():
        writer.add(name, elements_of(result))
    attributes += [TANGENT_BINDING] * reads_tangent
    look_ups = tuple(map(inputs.look_up, inputs.look_ups_read_by(writer.symbols)))
    tables = tuple(map(store_table, writer.tables))
    source = ProgramSource(
        look.name,
        tuple(writer.operations),
        writer.outputs,
        tuple(writer.constants),
        look_ups,
        tuple(attributes),
        tables,
        "",
        transmits=any(lobe.transmits or lobe.crosses_surface for lobe in lobes)
        or any(delta.transmits for delta in deltas),
        see_through=see_through,
        deltas=len(deltas),
        glossy=not any(lobe.broad or lobe.transmits or lobe.crosses_surface for lobe in lobes),
        shadows=shadows,
        recorded=tuple(group for group in LOBE_GROUPS if group in present),
    )
    digest = hashlib.sha256(repr(replace(source, name="")).encode()).hexdigest()
    return replace(source, digest=digest, folded=folded_lobe_count(graph, bsdf))


def trace_look(
    look: Look, inputs: SymbolicSurface, space: Space, live: LivePredicate = lambda number, name: False
) -> Bsdf:
    """Return the traced BSDF of a look in a colour space; the look's constants are uniforms, or symbols if live."""
    layers = enumerate(look_layers(look, inputs))
    bsdf = stack_bsdf([_trace_constants(inputs.graph, number, layer, live) for number, layer in layers])
    return bsdf if space == REC709 else bsdf.convert(matrix_from_rec709(space))


def _group_parts(mixture: Mixture, wi: Array) -> dict[str, tuple[Array, Array]]:
    """Return two arrays (3,) for each group of lobes, by group, for light from `wi` (3,).

    The first is the group's f times the cosine. The second is the part of the first from diffuse lobes.
    """
    parts: dict[str, tuple[Array, Array]] = {}
    for term in mixture.terms(wi):
        other = lobe_parts(term)
        rest = term.value - sum(other.values()) if other else term.value
        for group, part in {**other, recorded_group(term.lobe): rest}.items():
            value, diffuse = parts.get(group, (np.zeros(3), np.zeros(3)))
            parts[group] = value + part, diffuse + (part if term.lobe.group == "diffuse" else np.zeros(3))
    return parts


def stated_constants(look: Look) -> LivePredicate:
    """Return a predicate that is true for the constants of a look that can be live.

    These are the constants that the look's layers state. If a layer is of a foreign model, which has to be translated,
    no constant can be live.
    """
    names_by_layer = [
        {name for name, value in layer.inputs.items() if isinstance(value, float | tuple)} for layer in look.layers
    ]
    is_own_model = all(layer.model in MODELS for layer in look.layers)
    return lambda number, name: is_own_model and name in names_by_layer[number]


def live_name(layer: int, parameter: str) -> str:
    """Return the name of the symbol of a live constant, from its layer's index and its parameter."""
    return f"layer{layer}_{parameter}"


def live_numbers(look: Look, live: LivePredicate) -> Mapping[str, tuple[float, ...]]:
    """Return the values of the live constants of a look, by `live_name`."""
    layers = look_layers(look, SymbolicSurface(Graph(), _open_no_image))
    values = {(k, name): value for k, layer in enumerate(layers) for name, value in _layer_values(layer).items()}
    constants = {
        key: np.asarray(value) for key, value in values.items() if isinstance(value, _CONSTANT_TYPES) and live(*key)
    }
    return {live_name(*key): tuple(map(float, value.ravel())) for key, value in constants.items()}


def _trace_constants(graph: Graph, number: int, layer: StackLayer, live: LivePredicate) -> StackLayer:
    """Return a layer whose constants are uniforms, or symbols where they are live."""

    def trace(name: str, value: Floats | float) -> Array:
        if not live(number, name):
            return uniforms(graph, value)
        symbol_name = live_name(number, name)
        return vector_symbols(graph, symbol_name) if np.ndim(value) else symbol(graph, symbol_name)

    traced: dict[int, Array] = {}
    for name, value in _layer_values(layer).items():
        # A parameter that follows another one has the same object as value. It gets the same symbols.
        if isinstance(value, _CONSTANT_TYPES) and id(value) not in traced:
            traced[id(value)] = trace(name, value)
    parameters = {name: traced.get(id(value), value) for name, value in layer.parameters.items()}
    return replace(layer, parameters=parameters, mask=traced.get(id(layer.mask), layer.mask))


def _layer_values(layer: StackLayer) -> Parameters:
    """Return the values of a layer's parameters and of its ``"mask"``, by name."""
    return {**layer.parameters, "mask": layer.mask}


def _derivatives(
    graph: Graph, look: str, inputs: SymbolicSurface, outputs: Mapping[str, Real | list[Scalar]]
) -> Mapping[str, list[Scalar]]:
    """Return the derivatives of outputs with respect to each symbol of a live input, by `derivative_name`.

    Only the outputs ``value``, ``diffuse``, ``presence``, ``delta0``, ``delta1``, ... have derivatives.

    Raises
    ------
    CodegenError
        The direction of a delta depends on a live input.
    """
    live = [binding for binding in inputs.attributes.values() if is_live(binding.attribute)]
    names = [name for binding in live for name in binding.symbols]
    results = {}
    for name, (output, result) in product(names, outputs.items()):
        if output not in ("value", "diffuse", "presence") and not output.startswith("delta"):
            continue
        results[derivative_name(output, name)] = tangents = derivatives(graph, elements_of(result), name)
        if output.startswith("delta") and any(
            isinstance(tangent, GraphNode) or tangent != 0.0 for tangent in tangents[:3]
        ):
            raise CodegenError(
                f"{look}: a fitted parameter changes the direction of a delta lobe; derivatives of renders exist only "
                "for parameters that change values"
            )
    return results


def derivative_name(output: str, symbol: str) -> str:
    """Return the name of the derivative of an output with respect to a symbol."""
    return f"{output}/{symbol}"


def _open_no_image(texture: Texture | Bump) -> Path:
    """Stand in for the argument `resolve` where only constants are read."""
    raise AssertionError("no image is opened")


def _frame_outputs(graph: Graph, reads_tangent: bool, bends_normals: bool) -> Mapping[str, Array]:
    """Return the axes of the shading frame and the facet's normal, (3,) each, as functions of the mesh's symbols."""
    hand = symbol(graph, "hand") if bends_normals else 1.0
    tangent = vector_symbols(graph, "mesh_tangent") if reads_tangent else None
    normal, facet, viewer = (vector_symbols(graph, name) for name in ("mesh_normal", "mesh_facet", "viewer"))
    frame = shading_frame(normal, tangent, facet, viewer, hand)
    return {name: getattr(frame, name) for name in ("tangent", "bitangent", "normal", "facet")}


def store_table(table: NumberTable) -> Content:
    """Return the .npy file of a table's values, a flat array of float32; write it unless the cache has it."""

    def save(path: Path) -> None:
        np.save(path, np.asarray(table.values, np.float32).ravel())

    return cached_file("tables", f"{table.digest}.npy", ".npy", save)
