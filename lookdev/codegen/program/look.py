"""A look as a program: the traced graph, node by node, without a text between it and the renderer's own compiler.

- Jakob, W., Speierer, S., Roussel, N. and Vicini, D. 2022. Dr.Jit: A Just-In-Time Compiler for Differentiable
  Rendering. ACM Transactions on Graphics 41(4).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from lookdev.brdf import MODELS, StackLayer, stack_bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.mixture import Mixture, middle_albedo, middle_normal
from lookdev.brdf.table import Table
from lookdev.brdf.vectors import scale
from lookdev.cache import Content, derived
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.program.written import Written
from lookdev.codegen.source import HANDEDNESS, LOBE_GROUPS, TANGENT_BINDING, ImageBinding, ProgramSource
from lookdev.codegen.trace.azimuth import reads_tangent
from lookdev.codegen.trace.graph import Graph, Node
from lookdev.codegen.trace.lobes import WI, WO, assume_positive, continuous_lobes, folded_lobes, present_deltas
from lookdev.codegen.trace.slopes import slopes
from lookdev.codegen.trace.symbolic import elements_of, symbol, symbols, uniforms
from lookdev.errors import CodegenError
from lookdev.material import Bump, Look, Texture
from lookdev.material.change import is_live
from lookdev.material.values import look_layers
from lookdev.scene.shading import shading_frame
from lookdev.space import REC709, Space, from_rec709

Live = Callable[[int, str], bool]
_CONSTANT = (np.ndarray, float)


def generate_program(
    look: Look,
    resolve: Callable[[Texture | Bump], Path],
    *,
    shadows: bool = True,
    features: bool = False,
    space: Space = REC709,
    live: Live = lambda number, name: False,
) -> ProgramSource:
    """Generate the program of a look.

    Its constants are folded, and named, so that looks which differ in numbers alone have one text. `resolve` turns a
    texture into its linear EXR file, a height map into that of its slopes. With `shadows`, rays are traced along
    directions; `features` adds what guides a denoiser. `space` is that of the light.

    Constants that are `live`, by their layer's number from the base and their parameter (or ``"mask"``), do not fold:
    they are symbols by their `live_name`, three with ``[0]`` to ``[2]`` behind it. An editor changes them while the
    program stays. By inputs of `lookdev.material.change.live_look`, the program has derivatives.
    """
    graph = Graph()
    inputs = Inputs(graph, resolve)
    bsdf = stack_bsdf([_of_look(graph, *each, live) for each in enumerate(look_layers(look, inputs))])
    if space != REC709:
        bsdf = bsdf.converted(from_rec709(space))
    lobes, deltas = continuous_lobes(graph, bsdf), present_deltas(graph, bsdf)
    presence = elements_of(bsdf.presence)[0]
    see_through = isinstance(presence, Node) or presence < 1.0
    mixture = Mixture(lobes, symbols(graph, WO))
    # The shading frame is bent until the viewer is above its horizon. Lobes may be absent at some points: no branch
    # leaves their code out.
    assume_positive(graph, mixture.wo[..., 2])
    value, pdf = mixture.response(symbols(graph, WI))
    outputs: dict[str, Any] = {"value": value, "pdf": pdf}
    outputs["wi"] = mixture.draw(symbol(graph, "u1"), symbol(graph, "u2"))
    parts = _parts(mixture, symbols(graph, WI))
    outputs["diffuse"] = sum((diffuse for _, diffuse in parts.values()), np.zeros(3))
    for group, (of_group, diffuse) in parts.items():
        outputs[f"of_{group}"] = [*elements_of(of_group), *elements_of(diffuse)]
    for number, delta in enumerate(deltas):
        place = float(LOBE_GROUPS.index("transmission" if delta.transmits else "specular"))
        outputs[f"delta{number}"] = [*elements_of(delta.direction), *elements_of(delta.value), place]
    present = {*parts, *("transmission" if delta.transmits else "specular" for delta in deltas)}
    if see_through:
        outputs["presence"] = bsdf.presence
    if features:
        albedo: Any = middle_albedo(mixture) if lobes else np.zeros(3)
        for delta in deltas:
            albedo = albedo + delta.value
        outputs |= {"albedo": np.clip(albedo, 0.0, 1.0), "bent": middle_normal(mixture) if lobes else ZENITH}
    outputs |= _slopes(graph, look.name, inputs, outputs)
    directed = reads_tangent(graph, lobes)
    written = Written()
    for name, result in outputs.items():
        written.add(name, elements_of(result))
    attributes = inputs.read_by(written.symbols)
    leaning = any(each.attribute == HANDEDNESS for each in attributes)
    for name, result in _frame(graph, directed, leaning).items():
        written.add(name, elements_of(result))
    attributes += [TANGENT_BINDING] * directed
    look_ups = tuple(_image(inputs, name) for name in inputs.looked_up_by(written.symbols))
    tables = tuple(_content(table) for table in written.tables)
    made = ProgramSource(
        look.name,
        tuple(written.operations),
        written.outputs,
        tuple(written.constants),
        look_ups,
        tuple(attributes),
        tables,
        "",
        transmits=any(lobe.transmits or lobe.crosses for lobe in lobes) or any(delta.transmits for delta in deltas),
        see_through=see_through,
        deltas=len(deltas),
        glossy=not any(lobe.broad or lobe.transmits or lobe.crosses for lobe in lobes),
        shadows=shadows,
        recorded=tuple(group for group in LOBE_GROUPS if group in present),
    )
    digest = hashlib.sha256(repr(replace(made, name="")).encode()).hexdigest()
    return replace(made, digest=digest, folded=folded_lobes(graph, bsdf))


def _parts(mixture: Mixture, wi: Any) -> dict[str, tuple[Any, Any]]:
    """Return the value of the lobes of each group for light from `wi`, and the part of diffuse lobes."""
    parts: dict[str, tuple[Any, Any]] = {}
    for term in mixture.terms(wi):
        whole: Any = term.value
        found: dict[str, Any] = {}
        if not term.lobe.transmits:
            for name, evaluate in term.lobe.parts.items():
                part = replace(term, f=scale(evaluate(term.directions), term.lobe.weight)).value
                if any(isinstance(each, Node) or each > 0.0 for each in elements_of(part)):
                    found[name] = part
        rest = whole - sum(found.values()) if found else whole
        for group, part in {**found, "transmission" if term.lobe.transmits else term.lobe.group: rest}.items():
            value, diffuse = parts.get(group, (np.zeros(3), np.zeros(3)))
            parts[group] = value + part, diffuse + (part if term.lobe.group == "diffuse" else np.zeros(3))
    return parts


def stated(look: Look) -> Live:
    """Return which constants of a look may be live: those that its layers state, if all are of our own models."""
    given = [{name for name, each in layer.inputs.items() if isinstance(each, float | tuple)} for layer in look.layers]
    ours = all(layer.model in MODELS for layer in look.layers)
    return lambda number, name: ours and name in given[number]


def live_name(layer: int, parameter: str) -> str:
    """Return the symbol of a parameter of a layer."""
    return f"layer{layer}_{parameter}"


def live_numbers(look: Look, live: Live) -> Mapping[str, tuple[float, ...]]:
    """Return the constants of a look that are live, by their names."""
    layers = look_layers(look, Inputs(Graph(), _unopened))
    given = {(k, name): each for k, layer in enumerate(layers) for name, each in _values(layer).items()}
    constants = {key: np.asarray(each) for key, each in given.items() if isinstance(each, _CONSTANT) and live(*key)}
    return {live_name(*key): tuple(map(float, each.ravel())) for key, each in constants.items()}


def _of_look(graph: Graph, number: int, layer: StackLayer, live: Live) -> StackLayer:
    """Return a layer, its constants as uniforms or as symbols."""

    def traced(name: str, value: Any) -> Any:
        if not isinstance(value, _CONSTANT):
            return value
        if not live(number, name):
            return uniforms(graph, value)
        place = live_name(number, name)
        return symbols(graph, [f"{place}[{i}]" for i in range(3)]) if np.ndim(value) else symbol(graph, place)

    found: dict[int, Any] = {}
    for name, value in (given := _values(layer)).items():
        # By identity: a parameter that follows another has the same object.
        if id(value) not in found:
            found[id(value)] = traced(name, value)
    parameters = {name: found[id(given[name])] for name in layer.parameters}
    return replace(layer, parameters=parameters, mask=found[id(layer.mask)])


def _values(layer: StackLayer) -> Mapping[str, Any]:
    return {**layer.parameters, "mask": layer.mask}


def _slopes(graph: Graph, look: str, inputs: Inputs, outputs: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the derivatives of value, its diffuse part, presence and single directions by each symbol of live inputs.

    Raises CodegenError where a single direction turns with one: the picture changes by more than values then.
    """
    live = [each for each in inputs.attributes.values() if is_live(each.attribute)]
    names = [name for each in live for name in each.symbols]
    found = {}
    for name, (output, result) in product(names, outputs.items()):
        if output not in ("value", "diffuse", "presence") and not output.startswith("delta"):
            continue
        found[slope_name(output, name)] = derived = slopes(graph, elements_of(result), name)
        if output.startswith("delta") and any(isinstance(each, Node) or each != 0.0 for each in derived[:3]):
            raise CodegenError(
                f"{look}: a single direction turns with a parameter that is to be found, whose effect on pictures has "
                "no derivative that is an integral over directions"
            )
    return found


def slope_name(output: str, symbol: str) -> str:
    """Return the name of the derivative of an output by a symbol."""
    return f"{output}/{symbol}"


def _unopened(texture: Texture | Bump) -> Path:
    raise AssertionError("no image is opened")


def _frame(graph: Graph, directed: bool, leaning: bool) -> Mapping[str, Any]:
    """Return the axes of the shading frame and the facet's normal, by the symbols of the mesh."""

    def given(name: str) -> Any:
        return symbols(graph, [f"{name}[{i}]" for i in range(3)])

    hand: Any = symbol(graph, "hand") if leaning else 1.0
    tangent = given("mesh_tangent") if directed else None
    frame = shading_frame(given("mesh_normal"), tangent, given("mesh_facet"), given("viewer"), hand)
    axes = {"tangent": frame.tangent, "bitangent": frame.bitangent, "normal": frame.normal}
    return axes | {"facet": frame.facet}


def _image(inputs: Inputs, name: str) -> ImageBinding:
    found = inputs.look_up(name)
    texture = found.texture
    transform = tuple(float(x) for x in texture.transform)
    return ImageBinding(name, found.uv, found.slopes, texture.wrap_s, texture.wrap_t, transform, found.files)


def _content(table: Table) -> Content:
    def save(path: Path) -> None:
        np.save(path, np.asarray(table.values, np.float32).ravel())

    (content,) = derived("tables", f"{table.digest}.npy", lambda: (Content.written(".npy", save),))
    return content
