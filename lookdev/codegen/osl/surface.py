"""The light integral of a look as OSL: a hand-written template around the generated BSDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from types import MappingProxyType

import numpy as np

from lookdev.brdf import Array, Delta, Lobe, StackLayer, stack_bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.mixture import Mixture, estimate_albedo, mean_normal
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.osl.bsdf import emit_brdf, trace_lobes
from lookdev.codegen.osl.catching import catching_sections
from lookdev.codegen.osl.directions import direction_counts
from lookdev.codegen.osl.frame import emit_frame
from lookdev.codegen.osl.inputs import Names, emit_look_up
from lookdev.codegen.osl.light import light_sections
from lookdev.codegen.osl.tables import bind_tables
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import (
    FIRST_LIGHT_PART,
    HANDEDNESS,
    LOBE_GROUPS,
    TANGENT_BINDING,
    ShaderSource,
)
from lookdev.codegen.trace.azimuth import depends_on_tangent
from lookdev.codegen.trace.graph import Graph, Scalar
from lookdev.codegen.trace.lobes import WO, continuous_lobes, folded_lobes, present_deltas
from lookdev.codegen.trace.symbolic import elements_of, symbols, uniforms
from lookdev.errors import CodegenError
from lookdev.light import Light, coded, lights_code
from lookdev.light.lamps import CodedRig
from lookdev.material import Look
from lookdev.material.values import look_layers
from lookdev.scene.shading import LIFT
from lookdev.space import REC709, from_rec709

_OSL_TYPE = {"uv": "vector", "float": "float", "color": "color", "vector": "vector"}

# Share of a broad lobe in the directions drawn from the BSDF, without and with bounces. As it is light-sampled, these
# directions are only needed for light that the asset reflects. Measured (docs/bench.md): smaller shares are not better.
_BROAD_SHARES = (0.05, 0.3)

# In 1/sr. Of the light's directions for which a glossy BSDF has a smaller pdf, and smaller values, few are traced.
# Measured (docs/bench.md): the error of a metal does not grow, and roulette on more directions does not save more time.
_LEAST_DENSITY = 0.01


def expand_template(name: str, sections: Mapping[str, Sequence[str]]) -> str:
    """Fill a template, a file of `lookdev/shaders`.

    A line ``//@ NAME`` is replaced by the lines of that section, ``//@ include FILE`` by that file.

    Raises
    ------
    CodegenError
        The template has a section that `sections` lacks.
    """
    lines: list[str] = []
    for line in (files("lookdev") / "shaders" / name).read_text(encoding="utf-8").splitlines():
        command = line.strip().removeprefix("//@ ").split() if line.strip().startswith("//@ ") else []
        if command[:1] == ["include"]:
            lines += expand_template(command[1], sections).splitlines()
        elif command:
            if command[0] not in sections:
                raise CodegenError(f"template {name} has no such section: '{command[0]}'")
            lines += sections[command[0]]
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def generate_surface(
    look: Look, setting: SourceSetting, replaced: Mapping[str, Sequence[str]] = MappingProxyType({})
) -> ShaderSource:
    """Generate the light integral shader of a look.

    Parameters
    ----------
    look
        Its constants are folded. Textures that only absent lobes read are not looked up.
    replaced
        Lines that replace sections of the template, by the sections' names: the benchmark leaves out parts.
    """
    sampling, lights, space = setting.sampling, setting.lights, setting.space
    features, recorded, bounces = sampling.features, sampling.recorded, sampling.bounces
    graph = Graph()
    inputs = Inputs(graph, setting.image_file)
    bsdf = stack_bsdf([_trace_constants(graph, layer) for layer in look_layers(look, inputs)])
    if space != REC709:
        bsdf = bsdf.converted(from_rec709(space))
    lobes = continuous_lobes(graph, bsdf)
    deltas = present_deltas(graph, bsdf)
    constant = all(light.constant for light in lights)
    samples_light = sampling.ibl_samples != 0 and not constant
    counts = direction_counts(lobes, sampling.brdf_samples, sampling.ibl_samples, bounces, constant_light=constant)
    # If only one direction is drawn, it is not for light from behind.
    from_behind = min(counts.ibl, counts.ibl_onward) > 1
    if samples_light:
        share = _BROAD_SHARES[bounces > 0]
        lobes = [replace(lobe, share=lobe.share * share) if lobe.broad else lobe for lobe in lobes]
    transmits = any(lobe.transmits for lobe in lobes)

    def light_sampled(lobe: Lobe) -> bool:
        behind = lobe.transmits or (transmits and lobe.crosses)
        return counts.ibl > 0 and lobe.broad and (from_behind or not behind)

    traced = trace_lobes(graph, lobes, light_sampled, recorded=recorded)
    names = Names(inputs)
    rig = None if coded(lights) else CodedRig.of(lights)
    has_factors = rig is not None and rig.needs("split")
    guides = _guides(graph, continuous_lobes(graph, bsdf), deltas) if features else None
    presence = elements_of(bsdf.presence)[0]
    code = emit_brdf(
        traced, presence, spell=names.spell, by_group=has_factors, recorded=recorded, deltas=deltas, features=guides
    )
    deltas_transmit = any(delta.transmits for delta in deltas)
    groups = tuple(sorted({*code.groups}, key=LOBE_GROUPS.index))
    directed = depends_on_tangent(graph, lobes)
    attributes = [*inputs.attributes_read_by(code.inputs), *[TANGENT_BINDING] * directed]
    leaning = any(binding.attribute == HANDEDNESS for binding in attributes)
    look_up_code = [emit_look_up(name, inputs.look_up(source)) for source, name in names.given.items()]
    file_bindings = tuple(binding for _, bindings in look_up_code for binding in bindings)
    tables = bind_tables(code.tables)
    light_code = light_sections(lights)
    osl = expand_template(
        "surface.osl",
        {
            **light_code,
            "constants": [
                *light_code["constants"],
                f"#define IBL_SAMPLES {counts.ibl}",
                *_counts("", counts.brdf, counts.ibl, code.transmits),
                *_counts("_ONWARD", counts.brdf_onward, counts.ibl_onward, code.transmits),
                f"#define LIGHT_SAMPLED {int(code.light_sampled)}",
                f"#define LEAST_DENSITY {_LEAST_DENSITY}",
                f"#define BOUNCES {bounces}",
                f"#define SHADOWS {int(setting.shadows)}",
                f"#define LIFT {LIFT}",
                f"#define IMAGE_WIDTH {setting.resolution[0]}",
                f"#define IMAGE_HEIGHT {setting.resolution[1]}",
                f"#define TRANSMITS {int(code.transmits)}",
                f"#define DELTAS {len(deltas)}",
                f"#define DELTAS_TRANSMIT {int(deltas_transmit)}",
                f"#define SEE_THROUGH {int(code.see_through)}",
                f"#define FEATURES {int(features)}",
                f"#define RECORDED {int(recorded)}",
                *(_recording(groups, _shader_order(lights, setting.light_groups)) if recorded else ()),
                *lights_code(lights, sampled=counts.ibl > 0).constants,
                f"#define DIRECTED {int(directed)}",
                f"#define LEANING {int(leaning)}",
            ],
            "parameters": [
                *(f'    string {binding.parameter} = "",' for binding in file_bindings),
                *tables.parameters,
                *(f"    {_OSL_TYPE[attribute.kind]} {attribute.parameter} = 0," for attribute in attributes),
            ],
            **catching_sections(setting.catching),
            "frame": emit_frame(directed=directed, leaning=leaning),
            "inputs": [f"    {line}" for lines, _ in look_up_code for line in lines],
            **code.sections,
            **replaced,
        },
    )
    if not recorded:
        osl = _without_recording(osl)
    constants = tuple(names.constants)
    digest = hashlib.sha256(f"{osl}{constants}".encode())
    for binding in file_bindings:
        digest.update(binding.file.digest.encode())
    for attribute in attributes:
        digest.update(repr(attribute).encode())
    source = ShaderSource(
        look.name,
        osl,
        file_bindings,
        tuple(attributes),
        digest.hexdigest(),
        transmits=code.transmits or deltas_transmit,
        see_through=code.see_through,
        directions=(counts.brdf, counts.ibl),
        shadows=setting.shadows,
        tables=tables.bindings,
        constants=constants,
        folded=folded_lobes(graph, bsdf),
        catching=setting.catching,
    )
    return replace(source, recorded=groups) if recorded else source


def _shader_order(lights: Sequence[Light], groups: Sequence[int]) -> list[int]:
    """Return the group of each light, 0 without groups, in the order in which the shader numbers lights."""
    light_groups = groups or [0] * len(lights)
    if coded(lights):
        return list(light_groups)
    rig = CodedRig.of(lights)
    numbers = {id(light): number for number, light in enumerate(lights)}
    return [light_groups[numbers[id(light)]] for light in (*rig.lamps, *rig.domes)]


def _recording(lobes: Sequence[str], lights: Sequence[int]) -> list[str]:
    """Return the lines that define which groups of lobes, as indices of `LOBE_GROUPS`, and of lights are recorded."""
    numbers = [LOBE_GROUPS.index(name) for name in lobes] or [-1]  # a black look has none
    return [
        f"#define FIRST_LIGHT_PART {FIRST_LIGHT_PART}",
        f"#define RECORDED_LOBES {len(numbers)}",
        f"#define RECORDED_LOBE_NUMBERS {{ {', '.join(map(str, numbers))} }}",
        f"#define RECORDED_LIGHTS {len(lights)}",
        f"#define LIGHT_GROUP_NUMBERS {{ {', '.join(map(str, lights))} }}",
        f"#define LIGHT_GROUPS {max(lights) + 1}",
    ]


def _without_recording(osl: str) -> str:
    """Return a shader without the lines that only recording compiles, so that its digest does not depend on them."""
    lines: list[str] = []
    # Of each open condition: whether it is that of recording, and whether its lines are compiled.
    conditions: list[tuple[bool, bool]] = []
    for line in osl.splitlines(keepends=True):
        command = line.split()[:1]
        if command and command[0] in ("#if", "#ifdef", "#ifndef"):
            conditions.append((line.split() == ["#if", "RECORDED"], line.split() != ["#if", "RECORDED"]))
        in_recording, _ = conditions[-1] if conditions else (False, True)
        if in_recording and command == ["#else"]:
            conditions[-1] = (True, True)
        elif not (in_recording and command in (["#if"], ["#endif"])) and all(
            is_compiled for _, is_compiled in conditions
        ):
            lines.append(line)
        if command == ["#endif"]:
            conditions.pop()
    return "".join(lines)


def _guides(graph: Graph, lobes: Sequence[Lobe], deltas: Sequence[Delta]) -> dict[str, list[Scalar]]:
    """Return the features that guide a denoiser, numbers in [0, 1], by their names in the template."""
    mixture = Mixture(lobes, symbols(graph, WO))
    albedo: Array = estimate_albedo(mixture) if lobes else np.zeros(3)
    for delta in deltas:
        albedo = albedo + delta.value
    normal = mean_normal(mixture) if lobes else ZENITH
    return {"feature_albedo": elements_of(np.clip(albedo, 0.0, 1.0)), "feature_normal": elements_of(normal)}


def _trace_constants(graph: Graph, layer: StackLayer) -> StackLayer:
    """Return a layer whose constants are uniforms."""
    # Values are told apart by identity: a parameter that follows another has the same object.
    values = {id(value): value for value in (*layer.parameters.values(), layer.mask)}
    values = {key: uniforms(graph, v) if isinstance(v, np.ndarray | float) else v for key, v in values.items()}
    parameters = {name: values[id(value)] for name, value in layer.parameters.items()}
    return replace(layer, parameters=parameters, mask=values[id(layer.mask)])


def _counts(where: str, brdf_samples: int, ibl_samples: int, transmits: bool) -> list[str]:
    """Return the lines that define the numbers of directions; those of the light are divided between front and back."""
    back = ibl_samples // 2 if transmits else 0
    return [
        f"#define BRDF_SAMPLES{where} {brdf_samples}",
        f"#define FRONT_SAMPLES{where} {ibl_samples - back}",
        f"#define BACK_SAMPLES{where} {back}",
    ]
