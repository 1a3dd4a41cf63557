"""Node trees evaluated as Blender does, in float32, to compare with NumPy."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from lookdev.codegen.source import HANDEDNESS, GroupSocket, NodeLink, NodeTree, ShaderNode
from lookdev.material import Primvar

F = np.float32


@dataclass(frozen=True)
class PrimvarPoints:
    """Points with primvars and the handedness, by name, for views `wo`: a `Surface` of materials without UVs."""

    values: Mapping[str, Any]
    wo: Any = None

    def primvar(self, primvar: Primvar) -> Any:
        return self.values[primvar.name].astype(np.float64)

    def handedness(self) -> Any:
        return self.values[HANDEDNESS].astype(np.float64)

    def view(self) -> Any:
        return self.wo[..., 2].astype(np.float64)


def _where_valid(valid: Any, function: Callable[[], Any]) -> Any:
    with np.errstate(all="ignore"):
        return np.where(valid, function(), F(0.0))


def _power(a: Any, b: Any) -> Any:
    return _where_valid((a >= 0) | (b == np.floor(b)), lambda: np.power(a, b))


# As the Math nodes of Cycles: undefined results are 0.
MATH: dict[str, Callable[..., Any]] = {
    "ADD": lambda a, b: a + b,
    "SUBTRACT": lambda a, b: a - b,
    "MULTIPLY": lambda a, b: a * b,
    "DIVIDE": lambda a, b: _where_valid(b != 0, lambda: a / b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": _power,
    "LOGARITHM": lambda a, b: _where_valid((a > 0) & (b > 0), lambda: np.log(a) / np.log(b)),
    "SQRT": lambda a: np.sqrt(np.maximum(a, F(0.0))),
    "INVERSE_SQRT": lambda a: _where_valid(a > 0, lambda: F(1.0) / np.sqrt(a)),
    "ABSOLUTE": np.abs,
    "EXPONENT": np.exp,
    "MINIMUM": np.minimum,
    "MAXIMUM": np.maximum,
    "LESS_THAN": lambda a, b: (a < b).astype(F),
    "GREATER_THAN": lambda a, b: (a > b).astype(F),
    "FLOOR": np.floor,
    "SINE": np.sin,
    "COSINE": np.cos,
    "TANGENT": np.tan,
    "TANH": np.tanh,
    "ARCTAN2": np.arctan2,
}


def _dot(a: Any, b: Any) -> Any:
    return np.sum(a * b, axis=-1)


VECTOR_MATH: dict[str, Callable[..., Any]] = {
    **{name: MATH[name] for name in ("ADD", "SUBTRACT", "MULTIPLY", "DIVIDE", "MULTIPLY_ADD", "POWER", "ABSOLUTE")},
    **{name: MATH[name] for name in ("MINIMUM", "MAXIMUM", "FLOOR", "SINE", "COSINE", "TANGENT")},
    "SCALE": lambda a, scale: a * scale[..., None],
    "NORMALIZE": lambda a: a / np.sqrt(_dot(a, a))[..., None],
    "CROSS_PRODUCT": np.cross,
    "DOT_PRODUCT": _dot,
    "LENGTH": lambda a: np.sqrt(_dot(a, a)),
}

_SCALARS = {
    "Value", "Value_001", "Value_002", "X", "Y", "Z", "Scale", "Factor_Float", "A_Float", "B_Float", "Roughness",
    "Anisotropy", "Rotation", "IOR", "Fac", "Metallic", "Coat Weight", "Coat Roughness", "Coat IOR",
}  # fmt: skip


def shape_input(socket: str, value: Any, *, scalar: bool | None = None) -> Any:
    """Return a value in the shape of its socket: numbers (N,), vectors and colours (N, 3); shaders are unchanged."""
    if isinstance(value, list):
        return value
    value = np.asarray(value, dtype=F)
    if socket in _SCALARS if scalar is None else scalar:
        assert value.ndim < 2, f"a vector goes into {socket}"
        return np.atleast_1d(value)
    # A constant vector, or vectors; Blender spreads a number over one.
    is_vector = value.ndim == 2 or (value.shape == (3,) and scalar is None)
    return np.atleast_2d(value) if is_vector else np.atleast_1d(value)[..., None] * F([1, 1, 1])


Given = Callable[[ShaderNode], Mapping[str, Any] | None]


class Interpreter:
    """Evaluates trees; `scene_outputs` returns the outputs of nodes that read the scene, by identifier."""

    def __init__(self, trees: tuple[NodeTree, ...], scene_outputs: Given = lambda node: None) -> None:
        self.trees = {tree.name: tree for tree in trees}
        self.scene_outputs = scene_outputs

    def run(self, name: str, inputs: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the values of the sockets of a tree's output node.

        A shader is a list of closures: (kind, distribution, values of its sockets).
        """
        tree = self.trees[name]
        values: dict[str, Mapping[str, Any]] = {}
        output_values: dict[str, Any] = {}
        for node in tree.nodes:
            inputs_of_node = {
                socket: values[value.node].get(value.socket, []) if isinstance(value, NodeLink) else value
                for socket, value in node.inputs.items()
            }
            if node.kind == "NodeGroupOutput" or node.kind.startswith("Output"):
                output_values = inputs_of_node
            elif node.kind == "NodeGroupInput":
                values[node.name] = {socket.name: _of_socket(socket, inputs or {}) for socket in tree.inputs}
            elif node.kind == "Group":
                values[node.name] = self.scene_outputs(node) or self.run(node.group, inputs_of_node)
            else:
                # The IOR of a conductor is a vector.
                vector = "IOR" if "Extinction" in inputs_of_node else ""
                sockets = {
                    socket: shape_input(socket, value, scalar=False if socket == vector else None)
                    for socket, value in inputs_of_node.items()
                }
                values[node.name] = self.scene_outputs(node) or _node(node, sockets)
        return output_values


def _of_socket(socket: GroupSocket, inputs: Mapping[str, Any]) -> Any:
    if socket.kind == "shader":
        return inputs.get(socket.name, [])
    value = inputs.get(socket.name, socket.default)
    if isinstance(value, tuple):
        value = np.array([value])
    return shape_input(socket.name, value, scalar=socket.kind == "float")


def _node(node: ShaderNode, sockets: Mapping[str, Any]) -> dict[str, Any]:
    operation = str(node.properties.get("operation", ""))
    match node.kind:
        case "Math":
            return {"Value": MATH[operation](*sockets.values()).astype(F)}
        case "VectorMath":
            result = VECTOR_MATH[operation](*sockets.values()).astype(F)
            return {"Value" if operation in ("DOT_PRODUCT", "LENGTH") else "Vector": result}
        case "Mix":
            kind = str(node.properties["data_type"]).title()
            factor = sockets.get("Factor_Vector", sockets.get("Factor_Float"))
            if kind == "Vector" and "Factor_Float" in sockets:
                factor = factor[..., None]
            return {f"Result_{kind}": (sockets[f"A_{kind}"] * (1 - factor) + sockets[f"B_{kind}"] * factor).astype(F)}
        case "SeparateXYZ":
            return {axis: sockets["Vector"][..., index] for index, axis in enumerate("XYZ")}
        case "CombineXYZ":
            return {"Vector": np.stack(np.broadcast_arrays(*(sockets[axis] for axis in "XYZ")), axis=-1)}
        case "MixShader":
            factor = sockets["Fac"]
            below, above = sockets.get("Shader", []), sockets.get("Shader_001", [])
            return {"Shader": [*_faded(below, 1 - factor), *_faded(above, factor)]}
        case "AddShader":
            return {"Shader": [*sockets["Shader"], *sockets["Shader_001"]]}
        case kind if kind.startswith("Bsdf"):
            return {"BSDF": [(kind, str(node.properties.get("distribution", "")), dict(sockets))]}
    raise AssertionError(f"the interpreter has no {node.kind}")


def _faded(shader: list[Any], factor: Any) -> list[Any]:
    """Multiply closures by a weight, which is stored apart from their colours: these can be above 1."""
    return [
        (*kind, {**sockets, "Weight": sockets.get("Weight", F(1.0)) * factor[..., None]}) for *kind, sockets in shader
    ]
