"""Write a look as nodes with Cycles' own closures, for backend ``nodes`` and for an artist in Blender.

The material's own tree reads textures and primvars, evaluates mask expressions, and has the constants. Groups of nodes
contain the models, whose parameters are the groups' sockets. The base and the layers of the same model directly above
it share a group, which combines them by the model's rule or by blending their parameters. From the first layer of
another model upwards, each layer is a shader of its own, which is blended with the shader of the layers below.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookdev.brdf import (
    MASK,
    Bsdf,
    Parameter,
    Real,
    StackLayer,
    model_named,
    reflectance,
    split_by_combination,
    stack_bsdf,
)
from lookdev.brdf.vectors import are_equal
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.closures import add_closures, add_shaders, add_transparent, scale_shader
from lookdev.codegen.nodes.fits import fit_tree, is_fit
from lookdev.codegen.nodes.frame import add_frame, frame_tree, reads_frame_tangent
from lookdev.codegen.nodes.group import (
    TracedGroup,
    add_value,
    bind_symbols,
    followed_parameter,
    named_symbols,
    parameter_socket,
)
from lookdev.codegen.nodes.inputs import bind_inputs, node_digest
from lookdev.codegen.nodes.lift import GROUP as COINCIDENT
from lookdev.codegen.nodes.lift import coincident_tree
from lookdev.codegen.source import HANDEDNESS, TANGENT_BINDING, AttributeBinding, NodeLink, NodeSource, NodeTree
from lookdev.codegen.trace.graph import Graph, Symbol, reachable_nodes
from lookdev.codegen.trace.lobes import WO
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbols
from lookdev.material import Bump, Look, Texture
from lookdev.material.values import look_layers

_LAYERS = "Lookdev Layers"  # the name of a group that blends layers
_PRESENCE = Parameter("presence", "float", 1.0, help="How much of the surface is there.")
_REFLECTANCE = Parameter("reflectance", "float", 1.0, help="How much of the light the coat reflects to the viewer.")
# A group that blends shaders has sockets for these parameters of each shader.
_PART_PARAMETERS = {"mask": MASK, "presence": _PRESENCE, "reflectance": _REFLECTANCE}


@dataclass(frozen=True)
class _ShaderPart:
    """The shader of one layer or of several consecutive layers, as an output in the material's tree.

    `presence` and `reflectance` are arrays () of the material's graph. Only a coat has a reflectance.
    """

    shader: NodeLink
    presence: Real
    transmits: bool
    reflectance: Real | None = None


def generate_nodes(look: Look, resolve: Callable[[Texture | Bump], Path]) -> NodeSource:
    """Generate the nodes of a look, whose shaders are Cycles' own closures.

    Constants at which terms of a model vanish are folded. Other constants are values of sockets. `resolve` is as in
    `lookdev.codegen.inputs.SymbolicSurface`.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers do not fit together.
    TextureError
        An image is missing or unreadable.
    """
    return _Material(look, resolve).build_source()


class _Material:
    """A material under construction: its own tree, its groups, and the mesh attributes that they read."""

    def __init__(self, look: Look, resolve: Callable[[Texture | Bump], Path]) -> None:
        self._look = look
        self._graph = Graph()
        self._inputs = SymbolicSurface(self._graph, resolve)
        self._builder = TreeBuilder(look.name)
        self._groups: list[NodeTree] = []
        self._attributes: dict[AttributeBinding, None] = {}

    def build_source(self) -> NodeSource:
        """Build all trees, and return them as a source."""
        stack = look_layers(self._look, self._inputs)
        names = _unique_names(layer.name for layer in stack)
        # `stack_bsdf` raises ModelError if the layers do not fit together, even where the groups would omit some.
        presence = stack_bsdf(stack).presence
        first, *others = split_by_combination(stack)
        if not others:
            whole = self._add_model_layers(stack, names, part_name="")
        else:
            upper_names = names[len(first) :]
            parts = [self._add_model_layers(first, names[: len(first)], names[0])]
            parts += [self._add_model_layers(run, [name], name) for run, name in zip(others, upper_names, strict=True)]
            whole = self._mix_parts(parts, stack, names)
        coincident = self._builder.add("Group", inputs={"Shader": whole.shader}, group=COINCIDENT)
        self._builder.add("OutputMaterial", inputs={"Surface": NodeLink(coincident, "Shader")})
        attributes = sorted(self._attributes, key=lambda binding: binding.parameter)
        reads_tangent = any(map(reads_frame_tangent, self._groups))
        bends_normals = any(binding.attribute == HANDEDNESS for binding in attributes)
        frame = frame_tree(reads_tangent=reads_tangent, bends_normals=bends_normals)
        attributes += [TANGENT_BINDING] * reads_tangent
        used_groups = {node.group for tree in self._groups for node in tree.nodes}
        fits = [fit_tree(name) for name in sorted(used_groups) if is_fit(name)]
        see_through = not are_equal(presence, 1.0)
        trees = (frame, coincident_tree(see_through=see_through), *fits, *self._groups, self._builder.tree())
        return NodeSource(
            self._look.name,
            trees,
            tuple(attributes),
            node_digest(trees, attributes),
            exact=False,
            transmits=whole.transmits,
            see_through=see_through,
        )

    def _add_model_layers(self, stack: Sequence[StackLayer], names: Sequence[str], part_name: str) -> _ShaderPart:
        """Add groups of nodes for consecutive layers of one model, and return the layers' shader.

        `names` are the layers' names. The names of the groups end with `part_name`. It is empty if the layers are the
        whole look.
        """
        model = model_named(stack[0].model)
        if len(stack) == 1:
            group = TracedGroup(f"Lookdev {model.title} {part_name}".strip())
            return self._finish_group(group, _add_layer_inputs(group, stack), part_name)
        group = TracedGroup(f"{_LAYERS} {part_name}".strip())
        layers = _add_layer_inputs(group, stack, names)
        add_shading = self._finish_group if model.combine else self._blend_parameters
        return add_shading(group, layers, part_name)

    def _finish_group(
        self,
        group: TracedGroup,
        stack: Sequence[StackLayer],
        part_name: str,
        on_finished: Callable[[NodeTree], None] = lambda tree: None,
    ) -> _ShaderPart:
        """Add the closures of layers to their group, and a node of the group to the material's tree.

        The values of `stack` are those inside the group. `on_finished` is called with the group's tree before the node
        is added.
        """
        bsdf = stack_bsdf(stack)
        shader, transmits = _add_group_closures(group, bsdf)
        outputs: dict[str, Real] = {}
        if not part_name:
            shader = add_transparent(group.builder, shader, bsdf.presence)
        elif not are_equal(bsdf.presence, 1.0):
            outputs["presence"] = bsdf.presence
        if stack[0].mode == "coat":
            outputs["reflectance"] = reflectance(stack[0], symbols(group.graph, WO))
        tree = group.tree({parameter_socket(_PART_PARAMETERS[name]): value for name, value in outputs.items()}, shader)
        on_finished(tree)
        node = self._add_group(group, tree)
        output_symbols = {
            name: bind_symbols(self._graph, self._builder, f"{group.name} {name}", NodeLink(node, name), vector=False)
            for name in outputs
        }
        presence = output_symbols.get("presence", np.array(1.0))
        return _ShaderPart(NodeLink(node, "Shader"), presence, transmits, output_symbols.get("reflectance"))

    def _blend_parameters(self, layers: TracedGroup, stack: Sequence[StackLayer], part_name: str) -> _ShaderPart:
        """Add the group `layers`, which blends the parameters of `stack`, and a second group, which shades with them.

        The values of `stack` are those inside the group `layers`.
        """
        model = model_named(stack[0].model)
        parameters, blended = model.parameters, model.blend(stack)
        # The names of the blended values, which are symbols of the material's graph. These values are outputs of the
        # first group, and inputs of the second.
        symbol_names = {
            name: f"{layers.name} {followed_parameter(parameters[name], blended) or name}"
            for name, value in blended.items()
            if isinstance(value, SymbolicArray)
        }
        values = {
            name: named_symbols(self._graph, symbol_names[name], vector=parameters[name].kind != "float")
            if name in symbol_names
            else value
            for name, value in blended.items()
        }
        group = TracedGroup(f"Lookdev {model.title} {part_name}".strip())
        blended_layer = replace(stack[0], parameters=group.add_inputs(parameters, values))

        def add_layers_group(tree: NodeTree) -> None:
            """Add a node of the first group; its outputs are the inputs of `tree`, the tree of the second group."""
            names_read = [name for name in group.input_values(tree) if name in symbol_names]
            outputs = {parameter_socket(parameters[name]): blended[name] for name in names_read}
            node = self._add_group(layers, layers.tree(outputs, has_shader=False))
            for name in names_read:
                vector = parameters[name].kind != "float"
                bind_symbols(self._graph, self._builder, symbol_names[name], NodeLink(node, name), vector=vector)

        return self._finish_group(group, [blended_layer], part_name, add_layers_group)

    def _mix_parts(
        self, parts: Sequence[_ShaderPart], stack: Sequence[StackLayer], names: Sequence[str]
    ) -> _ShaderPart:
        """Blend shaders of layers, base first, in a group, and return the blended shader.

        `stack` and `names` are all layers of the look, and their names. Two layers blend to
        ``mask * f_above + (1 - mask * presence_above) * f_below``. If the upper layer is a coat, its reflectance also
        multiplies ``mask * presence_above``.
        """
        group = TracedGroup(_LAYERS)
        above = len(parts) - 1  # the number of layers above the base that are blended as shaders
        panels = [names[0], *names[-above:]]  # the heading of each part's sockets
        # The base does not cover anything, so its mask has no effect.
        layers = [replace(stack[0], mask=np.array(1.0)), *stack[-above:]]
        shaders = {f"{panel} shader": part.shader for panel, part in zip(panels, parts, strict=True)}
        total: NodeLink | None = None
        presence: Real = np.array(0.0)
        for panel, part, layer in zip(panels, parts, layers, strict=True):
            shader = group.add_shader_input(f"{panel} shader", panel)
            values = {"mask": layer.mask, "presence": part.presence}
            if part.reflectance is not None:
                values["reflectance"] = part.reflectance
            inside_values = group.add_inputs(_PART_PARAMETERS, values, panel)
            presence_of_part = inside_values["mask"] * inside_values["presence"]
            coverage = presence_of_part if part.reflectance is None else presence_of_part * inside_values["reflectance"]
            total = _layer_over(group.builder, shader, total, inside_values["mask"], coverage)
            if part.reflectance is None:
                presence = 1.0 - (1.0 - presence_of_part) * (1.0 - presence)
        tree = group.tree({}, add_transparent(group.builder, total, presence))
        node = self._add_group(group, tree, shaders)
        return _ShaderPart(NodeLink(node, "Shader"), np.array(1.0), any(part.transmits for part in parts))

    def _add_group(self, group: TracedGroup, tree: NodeTree, shaders: Mapping[str, NodeLink] | None = None) -> str:
        """Add a node of a finished group to the material's tree, and return the node's name.

        The nodes that the inputs of the group's node read are also added. `shaders` is as in `TracedGroup.add_to`.
        """
        self._groups.append(tree)
        elements = [element for value in group.input_values(tree).values() for element in elements_of(value)]
        names = [node.name for node in reachable_nodes(elements) if isinstance(node, Symbol)]
        self._attributes |= dict.fromkeys(bind_inputs(self._builder, self._inputs, names))
        if WO[2] in names:
            add_frame(self._builder)
        return group.add_to(self._builder, tree, shaders)


def _add_group_closures(group: TracedGroup, bsdf: Bsdf) -> tuple[NodeLink | None, bool]:
    """Add the shading frame and the closures of a BSDF to a group, and return what `add_closures` returns."""
    # The symbols' names begin with "frame." to be unique: the names of parameters and layers do not contain dots.
    bases = [
        bind_symbols(group.graph, group.builder, f"frame.{name}", link, vector=True)
        for name, link in add_frame(group.builder).items()
    ]
    return add_closures(group.graph, group.builder, bsdf, np.stack(bases))


def _layer_over(
    builder: TreeBuilder, above: NodeLink, below: NodeLink | None, mask: Real, coverage: Real
) -> NodeLink | None:
    """Return the shader ``mask * above + (1 - coverage) * below``; None is a black shader."""
    if below is not None and are_equal(mask, coverage) and not are_equal(mask, 0.0) and not are_equal(mask, 1.0):
        inputs = {"Fac": add_value(builder, mask), "Shader": below, "Shader_001": above}
        return NodeLink(builder.add("MixShader", inputs=inputs), "Shader")
    return add_shaders(builder, scale_shader(builder, below, 1.0 - coverage), scale_shader(builder, above, mask))


def _add_layer_inputs(
    group: TracedGroup, stack: Sequence[StackLayer], names: Sequence[str] = ("",)
) -> list[StackLayer]:
    """Add the inputs of layers to a group, and return the layers with their values inside the group.

    `names` are the headings of the layers' sockets. The base has no mask.
    """
    layers = []
    for number, (layer, panel) in enumerate(zip(stack, names, strict=True)):
        mask = group.add_inputs({"mask": MASK}, {"mask": layer.mask}, panel)["mask"] if number else np.array(1.0)
        parameters = group.add_inputs(model_named(layer.model).parameters, layer.parameters, panel)
        layers.append(replace(layer, mask=mask, parameters=parameters))
    return layers


def _unique_names(names: Iterator[str]) -> list[str]:
    """Return names that are all different: a number, from 2, is appended to a name that equals an earlier name."""
    unique: list[str] = []
    for name in names:
        number, new = 2, name
        while new in unique:
            number, new = number + 1, f"{name} {number}"
        unique.append(new)
    return unique
