"""A look as Cycles' own closures, for backend ``nodes`` and for an artist in Blender.

The material's tree has textures, primvars, mask expressions and constants; groups have the models, whose parameters are
sockets. Layers of one model are combined in one group, by the model's rule or as blended parameters. From the first
layer of another model on, shaders are blended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from lookdev.brdf import MASK, Bsdf, Parameter, Real, StackLayer, model_named, reflectance, runs, stack_bsdf
from lookdev.brdf.vectors import same
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.closures import add_shaders, add_transparent, shade
from lookdev.codegen.nodes.fits import fit_tree, is_fit
from lookdev.codegen.nodes.frame import add_frame, frame_tree, reads_frame_tangent
from lookdev.codegen.nodes.group import Group, bound, built, followed_by, socket_of, symbols_of
from lookdev.codegen.nodes.inputs import bind_inputs, node_digest
from lookdev.codegen.nodes.lift import GROUP as COINCIDENT
from lookdev.codegen.nodes.lift import coincident_tree
from lookdev.codegen.source import HANDEDNESS, TANGENT_BINDING, AttributeBinding, Link, NodeSource, NodeTree
from lookdev.codegen.trace.graph import Graph, reachable
from lookdev.codegen.trace.lobes import WO
from lookdev.codegen.trace.symbolic import SymbolicArray, elements_of, symbols
from lookdev.material import Bump, Look, Texture
from lookdev.material.values import look_layers

_LAYERS = "Lookdev Layers"
_PRESENCE = Parameter("presence", "float", 1.0, help="How much of the surface is there.")
_REFLECTANCE = Parameter("reflectance", "float", 1.0, help="How much of the light the coat reflects to the viewer.")
_OF_PART = {"mask": MASK, "presence": _PRESENCE, "reflectance": _REFLECTANCE}


@dataclass(frozen=True)
class _Part:
    """The shader of some of the layers; their presence in the material's graph; as a coat, what it reflects."""

    shader: Link
    presence: Real
    transmits: bool
    reflectance: Real | None = None


def generate_nodes(look: Look, resolve: Callable[[Texture | Bump], Path]) -> NodeSource:
    """Generate the closures of a look; parameters as of `lookdev.codegen.osl.surface.generate_surface`.

    Constants at which terms vanish are folded; other constants are values of sockets.

    Raises
    ------
    ModelError
        A constant is outside its hard range, or the layers do not fit together.
    TextureError
        An image is missing or unreadable.
    """
    return _Material(look, resolve).source()


class _Material:
    """The material's own tree while it is built, and the groups so far."""

    def __init__(self, look: Look, resolve: Callable[[Texture | Bump], Path]) -> None:
        self._look = look
        self._graph = Graph()
        self._inputs = Inputs(self._graph, resolve)
        self._builder = TreeBuilder(look.name)
        self._groups: list[NodeTree] = []
        self._attributes: dict[AttributeBinding, None] = {}

    def source(self) -> NodeSource:
        stack = look_layers(self._look, self._inputs)
        names = _unique(layer.name for layer in stack)
        # Raises if layers do not fit together, also layers that vanish.
        presence = stack_bsdf(stack).presence
        first, *others = runs(stack)
        if not others:
            whole = self._run(stack, names, part="")
        else:
            parts = [self._run(first, names[: len(first)], names[0])]
            parts += [self._run(run, [name], name) for run, name in zip(others, names[len(first) :], strict=True)]
            whole = self._mixed(parts, stack, names)
        passing = self._builder.add("Group", inputs={"Shader": whole.shader}, group=COINCIDENT)
        self._builder.add("OutputMaterial", inputs={"Surface": Link(passing, "Shader")})
        attributes = sorted(self._attributes, key=lambda binding: binding.parameter)
        directed = any(map(reads_frame_tangent, self._groups))
        frame = frame_tree(directed=directed, leaning=any(binding.attribute == HANDEDNESS for binding in attributes))
        attributes += [TANGENT_BINDING] * directed
        shown = {node.group for tree in self._groups for node in tree.nodes}
        fits = [fit_tree(name) for name in sorted(shown) if is_fit(name)]
        see_through = not same(presence, 1.0)
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

    def _run(self, stack: Sequence[StackLayer], names: Sequence[str], part: str) -> _Part:
        """Add the groups of layers of one model; `part` names them where they are not the whole look."""
        model = model_named(stack[0].model)
        if len(stack) == 1:
            group = Group(f"Lookdev {model.title} {part}".strip())
            return self._shaded(group, _taken(group, stack), part)
        group = Group(f"{_LAYERS} {part}".strip())
        layers = _taken(group, stack, names)
        return self._shaded(group, layers, part) if model.combine else self._parameters(group, layers, part)

    def _shaded(
        self,
        group: Group,
        stack: Sequence[StackLayer],
        part: str,
        finished: Callable[[NodeTree], None] = lambda tree: None,
    ) -> _Part:
        """Finish a group that shades by the layers taken into it; call `finished` before it is shown."""
        bsdf = stack_bsdf(stack)
        shader, transmits = _closures(group, bsdf)
        given: dict[str, Real] = {}
        if not part:
            shader = add_transparent(group.builder, shader, bsdf.presence)
        elif not same(bsdf.presence, 1.0):
            given["presence"] = bsdf.presence
        if stack[0].mode == "coat":
            given["reflectance"] = reflectance(stack[0], symbols(group.graph, WO))
        tree = group.tree({socket_of(_OF_PART[name]): value for name, value in given.items()}, shader)
        finished(tree)
        node = self._show(group, tree)
        outside = {
            name: bound(self._graph, self._builder, f"{group.name} {name}", Link(node, name), vector=False)
            for name in given
        }
        presence = outside.get("presence", np.array(1.0))
        return _Part(Link(node, "Shader"), presence, transmits, outside.get("reflectance"))

    def _parameters(self, layers: Group, stack: Sequence[StackLayer], part: str) -> _Part:
        """Finish a group that blends the parameters of layers, and add one that shades by them."""
        model = model_named(stack[0].model)
        known, blended = model.parameters, model.blended(stack)
        # The outputs of the first group are the inputs that the second reads.
        between = {
            name: f"{layers.name} {followed_by(known[name], blended) or name}"
            for name, value in blended.items()
            if isinstance(value, SymbolicArray)
        }
        outside = {
            name: symbols_of(self._graph, between[name], vector=known[name].kind != "float")
            if name in between
            else value
            for name, value in blended.items()
        }
        group = Group(f"Lookdev {model.title} {part}".strip())
        shading = replace(stack[0], parameters=group.take(known, outside))

        def show_layers(tree: NodeTree) -> None:
            read = [name for name in group.wanted(tree) if name in between]
            outputs = {socket_of(known[name]): blended[name] for name in read}
            node = self._show(layers, layers.tree(outputs, shades=False))
            for name in read:
                vector = known[name].kind != "float"
                bound(self._graph, self._builder, between[name], Link(node, name), vector=vector)

        return self._shaded(group, [shading], part, show_layers)

    def _mixed(self, parts: Sequence[_Part], stack: Sequence[StackLayer], names: Sequence[str]) -> _Part:
        """Blend shaders, base first: f is ``mask * f_above + (1 - mask * presence_above) * f_below``.

        Of a coat, what it hides is multiplied by what it reflects.
        """
        group = Group(_LAYERS)
        above = len(parts) - 1
        panels = [names[0], *names[-above:]]
        # The base covers nothing: its mask has no effect.
        layers = [replace(stack[0], mask=np.array(1.0)), *stack[-above:]]
        shaders = {f"{panel} shader": part.shader for panel, part in zip(panels, parts, strict=True)}
        total: Link | None = None
        presence: Real = np.array(0.0)
        for panel, part, layer in zip(panels, parts, layers, strict=True):
            shader = group.take_shader(f"{panel} shader", panel)
            values = {"mask": layer.mask, "presence": part.presence}
            if part.reflectance is not None:
                values["reflectance"] = part.reflectance
            inside = group.take(_OF_PART, values, panel)
            covered = inside["mask"] * inside["presence"]
            hidden = covered if part.reflectance is None else covered * inside["reflectance"]
            total = _over(group.builder, shader, total, inside["mask"], hidden)
            if part.reflectance is None:
                presence = 1.0 - (1.0 - covered) * (1.0 - presence)
        tree = group.tree({}, add_transparent(group.builder, total, presence))
        node = self._show(group, tree, shaders)
        return _Part(Link(node, "Shader"), np.array(1.0), any(part.transmits for part in parts))

    def _show(self, group: Group, tree: NodeTree, shaders: Mapping[str, Link] | None = None) -> str:
        """Add a finished group and the inputs that it reads to the material's tree; return the node's name."""
        self._groups.append(tree)
        elements = [element for value in group.wanted(tree).values() for element in elements_of(value)]
        names = [str(node.args[0]) for node in reachable(elements) if node.op == "symbol"]
        self._attributes |= dict.fromkeys(bind_inputs(self._builder, self._inputs, names))
        if WO[2] in names:
            add_frame(self._builder)
        return group.show(self._builder, tree, shaders)


def _closures(group: Group, bsdf: Bsdf) -> tuple[Link | None, bool]:
    """Add the frame and the closures of a BSDF to a group; return their sum and whether light passes through."""
    frame = add_frame(group.builder)
    # Names of parameters and layers have no dot.
    axes = {"frame.tangent": frame.tangent, "frame.bitangent": frame.bitangent, "frame.normal": frame.normal}
    bases = [bound(group.graph, group.builder, name, link, vector=True) for name, link in axes.items()]
    return shade(group.graph, group.builder, bsdf, np.stack(bases))


def _over(builder: TreeBuilder, above: Link, below: Link | None, mask: Real, hidden: Real) -> Link | None:
    """Lay a shader on another, of which the share `hidden` is not seen."""
    if below is not None and same(mask, hidden) and not same(mask, 0.0) and not same(mask, 1.0):
        inputs = {"Fac": built(builder, mask), "Shader": below, "Shader_001": above}
        return Link(builder.add("MixShader", inputs=inputs), "Shader")
    return add_shaders(builder, _scaled(builder, below, 1.0 - hidden), _scaled(builder, above, mask))


def _scaled(builder: TreeBuilder, shader: Link | None, factor: Real) -> Link | None:
    """Multiply a shader by a number from 0 to 1."""
    if shader is None or same(factor, 0.0):
        return None
    if same(factor, 1.0):
        return shader
    return Link(builder.add("MixShader", inputs={"Fac": built(builder, factor), "Shader_001": shader}), "Shader")


def _taken(group: Group, stack: Sequence[StackLayer], names: Sequence[str] = ("",)) -> list[StackLayer]:
    """Return layers as they are inside a group; with several layers each has a panel, named by `names`."""
    taken = []
    for number, (layer, panel) in enumerate(zip(stack, names, strict=True)):
        mask = group.take({"mask": MASK}, {"mask": layer.mask}, panel)["mask"] if number else np.array(1.0)
        parameters = group.take(model_named(layer.model).parameters, layer.parameters, panel)
        taken.append(replace(layer, mask=mask, parameters=parameters))
    return taken


def _unique(names: Iterator[str]) -> list[str]:
    """Number names that repeat."""
    unique: list[str] = []
    for name in names:
        number, new = 2, name
        while new in unique:
            number, new = number + 1, f"{name} {number}"
        unique.append(new)
    return unique
