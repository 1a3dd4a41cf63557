"""The node definitions on disk agree with the parameters of the models."""

import pytest
from pxr import Sdr, Usd, UsdShade

from lookdev.brdf import MODELS, Parameter, layer_shaders
from lookdev.material.definitions import DEFINED_LAYERS, DEFINITIONS, shader_definitions

pytestmark = pytest.mark.both_pythons


@pytest.fixture(scope="module")
def nodes() -> dict[str, Sdr.ShaderNode]:
    """Return every node of the file, as another tool reads it."""
    stage = Usd.Stage.Open(str(DEFINITIONS))
    sdr_nodes = {}
    for prim in stage.Traverse():
        for result in UsdShade.ShaderDefUtils.GetDiscoveryResults(UsdShade.Shader(prim), str(DEFINITIONS)):
            Sdr.Registry().AddDiscoveryResult(result)
            sdr_nodes[result.identifier] = Sdr.Registry().GetShaderNodeByIdentifier(result.identifier)
    return sdr_nodes


def test_file_is_written_from_the_parameters() -> None:
    assert DEFINITIONS.read_text(encoding="utf-8") == shader_definitions(), "run python -m lookdev.material.definitions"


def test_nodes_and_inputs(nodes: dict[str, Sdr.ShaderNode]) -> None:
    others = {"LookdevBump", "LookdevDisplacement", "LookdevExpression", "LookdevLayers"}
    assert set(nodes) == {*layer_shaders(), *others}
    for node, model in layer_shaders().items():
        assert sorted(nodes[node].GetShaderInputNames()) == sorted(MODELS[model].parameters)
        assert nodes[node].GetShaderOutputNames() == ["layer"]
    assert nodes["LookdevLayers"].GetShaderOutputNames() == ["surface"]


@pytest.mark.parametrize(
    ("node", "parameter"),
    [
        pytest.param(node, parameter, id=f"{model}-{parameter.name}")
        for node, model in layer_shaders().items()
        for parameter in MODELS[model].parameters.values()
    ],
)
def test_input_agrees_with_its_parameter(nodes: dict[str, Sdr.ShaderNode], node: str, parameter: Parameter) -> None:
    node_input = nodes[node].GetShaderInput(parameter.name)
    usd_types = {"float": "float", "color": "color3f", "normal": "normal3f", "token": "token"}
    assert str(node_input.GetTypeAsSdfType().GetSdfType()) == ("asset" if parameter.file else usd_types[parameter.kind])
    assert node_input.GetHelp() == parameter.help != ""
    default, metadata = node_input.GetDefaultValueAsSdfType(), node_input.GetMetadata()
    if parameter.file:
        assert default.path == parameter.default == ""
        assert not node_input.IsConnectable()
    elif parameter.kind == "token":
        assert default == parameter.default
        assert [name for name, _ in node_input.GetOptions()] == list(parameter.choices)
        assert not node_input.IsConnectable()
    else:
        assert default == pytest.approx(parameter.default, rel=2.0**-24)  # stored as float32
        assert node_input.IsConnectable()
        assert (float(metadata["hardMin"]), float(metadata["hardMax"])) == parameter.hard
        assert (float(metadata["softMin"]), float(metadata["softMax"])) == parameter.soft


def inputs_of(node: Sdr.ShaderNode) -> dict[str, tuple[str, object, bool, list[str]]]:
    """Return type, default, connectability and options of each input; check that all have a help text."""
    inputs = {name: node.GetShaderInput(name) for name in node.GetShaderInputNames()}
    assert all(node_input.GetHelp() for node_input in inputs.values())
    types = {name: str(node_input.GetTypeAsSdfType().GetSdfType()) for name, node_input in inputs.items()}
    options = {name: [option for option, _ in node_input.GetOptions()] for name, node_input in inputs.items()}
    return {
        name: (types[name], node_input.GetDefaultValueAsSdfType(), node_input.IsConnectable(), options[name])
        for name, node_input in inputs.items()
    }


def test_inputs_of_other_nodes(nodes: dict[str, Sdr.ShaderNode]) -> None:
    layers = inputs_of(nodes["LookdevLayers"])
    types = {"": "token", "Mask": "float", "Enabled": "bool", "Mode": "token"}
    assert {name: kind for name, (kind, *_) in layers.items()} == {"base": "token"} | {
        f"layer{number}{suffix}": kind for number in range(1, DEFINED_LAYERS + 1) for suffix, kind in types.items()
    }
    assert [layers[f"layer3{suffix}"][1] for suffix in ("Mask", "Enabled", "Mode")] == [1.0, True, "over"]
    assert layers["layer3Mode"][3] == ["over", "transmit"]
    assert inputs_of(nodes["LookdevDisplacement"]) == {
        "height": ("float", 0.0, True, []),
        "scale": ("float", 1.0, False, []),
        "midlevel": ("float", 0.0, False, []),
        "units": ("token", "object", False, ["object", "world"]),
    }
    bump = nodes["LookdevBump"]
    inputs = inputs_of(bump)
    assert inputs == {"height": ("float", inputs["height"][1], True, []), "scale": ("float", 1.0, False, [])}
    assert str(bump.GetShaderOutput("normal").GetTypeAsSdfType().GetSdfType()) == "normal3f"
