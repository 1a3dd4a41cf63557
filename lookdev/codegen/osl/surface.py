"""The light integral of a look: a hand-written OSL template around the generated BSDF."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from types import MappingProxyType
from typing import Any

import numpy as np

from lookdev.brdf import Delta, Lobe, StackLayer, stack_bsdf
from lookdev.brdf.frames import ZENITH
from lookdev.brdf.mixture import Mixture, middle_albedo, middle_normal
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.osl.bsdf import emit_brdf, trace_lobes
from lookdev.codegen.osl.catching import catching_sections
from lookdev.codegen.osl.directions import directions
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
from lookdev.codegen.trace.graph import Graph
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

# Share of a broad lobe in the directions drawn from the BSDF, without and with bounces: light-sampled, it needs
# directions of its own only for light that the asset reflects. Measured (docs/bench.md): smaller shares are no better.
_BROAD_SHARES = (0.05, 0.3)

# In 1/sr. Of the light's directions to which a glossy BSDF has a smaller pdf, and smaller values, few are traced.
# Measured (docs/bench.md): a metal's error does not grow, and roulette on more directions saves no more time.
_LEAST_DENSITY = 0.01


def expand_template(name: str, sections: Mapping[str, Sequence[str]]) -> str:
    """Fill a template, a file of `lookdev/shaders`; an unknown section is a CodegenError.

    A line ``//@ NAME`` is replaced by the lines of that section, ``//@ include FILE`` by that file.
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
        Constants in it are folded; textures that only vanished lobes read are not looked up.
    replaced
        Other lines for sections of the template, by their names: the benchmark leaves parts out.
    """
    sampling, lights, space = setting.sampling, setting.lights, setting.space
    features, recorded, bounces = sampling.features, sampling.recorded, sampling.bounces
    graph = Graph()
    inputs = Inputs(graph, setting.image_file)
    bsdf = stack_bsdf([_of_look(graph, layer) for layer in look_layers(look, inputs)])
    if space != REC709:
        bsdf = bsdf.converted(from_rec709(space))
    lobes = continuous_lobes(graph, bsdf)
    deltas = present_deltas(graph, bsdf)
    constant = all(light.constant for light in lights)
    by_light = sampling.ibl_samples != 0 and not constant
    drawn = directions(lobes, sampling.brdf_samples, sampling.ibl_samples, bounces, constant_light=constant)
    # Of a single direction none is for light from behind.
    from_behind = min(drawn.ibl, drawn.ibl_onward) > 1
    if by_light:
        share = _BROAD_SHARES[bounces > 0]
        lobes = [replace(lobe, share=lobe.share * share) if lobe.broad else lobe for lobe in lobes]
    transmits = any(lobe.transmits for lobe in lobes)

    def light_sampled(lobe: Lobe) -> bool:
        behind = lobe.transmits or (transmits and lobe.crosses)
        return drawn.ibl > 0 and lobe.broad and (from_behind or not behind)

    traced = trace_lobes(graph, lobes, light_sampled, recorded=recorded)
    names = Names(inputs)
    rig = None if coded(lights) else CodedRig.of(lights)
    split = rig is not None and rig.split
    guides = _guides(graph, continuous_lobes(graph, bsdf), deltas) if features else None
    presence = elements_of(bsdf.presence)[0]
    code = emit_brdf(
        traced, presence, spell=names.spell, by_group=split, recorded=recorded, deltas=deltas, features=guides
    )
    passes = any(delta.transmits for delta in deltas)
    groups = tuple(sorted({*code.groups}, key=LOBE_GROUPS.index))
    directed = depends_on_tangent(graph, lobes)
    attributes = [*inputs.read_by(code.inputs), *[TANGENT_BINDING] * directed]
    leaning = any(each.attribute == HANDEDNESS for each in attributes)
    emitted = [emit_look_up(name, inputs.look_up(source)) for source, name in names.given.items()]
    bound = tuple(binding for _, bindings in emitted for binding in bindings)
    tables = bind_tables(code.tables)
    of_lights = light_sections(lights)
    osl = expand_template(
        "surface.osl",
        {
            **of_lights,
            "constants": [
                *of_lights["constants"],
                f"#define IBL_SAMPLES {drawn.ibl}",
                *_counts("", drawn.brdf, drawn.ibl, code.transmits),
                *_counts("_ONWARD", drawn.brdf_onward, drawn.ibl_onward, code.transmits),
                f"#define LIGHT_SAMPLED {int(code.light_sampled)}",
                f"#define LEAST_DENSITY {_LEAST_DENSITY}",
                f"#define BOUNCES {bounces}",
                f"#define SHADOWS {int(setting.shadows)}",
                f"#define LIFT {LIFT}",
                f"#define IMAGE_WIDTH {setting.resolution[0]}",
                f"#define IMAGE_HEIGHT {setting.resolution[1]}",
                f"#define TRANSMITS {int(code.transmits)}",
                f"#define DELTAS {len(deltas)}",
                f"#define DELTAS_TRANSMIT {int(passes)}",
                f"#define SEE_THROUGH {int(code.see_through)}",
                f"#define FEATURES {int(features)}",
                f"#define RECORDED {int(recorded)}",
                *(_recording(groups, _shader_order(lights, setting.light_groups)) if recorded else ()),
                *lights_code(lights, sampled=drawn.ibl > 0).constants,
                f"#define DIRECTED {int(directed)}",
                f"#define LEANING {int(leaning)}",
            ],
            "parameters": [
                *(f'    string {binding.parameter} = "",' for binding in bound),
                *tables.parameters,
                *(f"    {_OSL_TYPE[attribute.kind]} {attribute.parameter} = 0," for attribute in attributes),
            ],
            **catching_sections(setting.catching),
            "frame": emit_frame(directed=directed, leaning=leaning),
            "inputs": [f"    {line}" for lines, _ in emitted for line in lines],
            **code.sections,
            **replaced,
        },
    )
    if not recorded:
        osl = _without_recording(osl)
    constants = tuple(names.constants)
    digest = hashlib.sha256(f"{osl}{constants}".encode())
    for binding in bound:
        digest.update(binding.file.digest.encode())
    for attribute in attributes:
        digest.update(repr(attribute).encode())
    passing, numbers = (code.transmits or passes, code.see_through), (drawn.brdf, drawn.ibl)
    known = bound, tuple(attributes), digest.hexdigest(), *passing, numbers, setting.shadows, tables.bindings, constants
    made = ShaderSource(look.name, osl, *known, folded=folded_lobes(graph, bsdf), catching=setting.catching)
    return replace(made, recorded=groups) if recorded else made


def _shader_order(lights: Sequence[Light], groups: Sequence[int]) -> list[int]:
    """Return the groups of lights, 0 without, in the order in which a shader numbers the lights."""
    given = groups or [0] * len(lights)
    if coded(lights):
        return list(given)
    rig = CodedRig.of(lights)
    numbers = {id(light): number for number, light in enumerate(lights)}
    return [given[numbers[id(light)]] for light in (*rig.lamps, *rig.domes)]


def _recording(lobes: Sequence[str], lights: Sequence[int]) -> list[str]:
    """Define what shaders record: the groups of their lobes among `LOBE_GROUPS`, and those of their lights."""
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
    """Return a shader without the lines that are compiled only where light is recorded: its digest is without them."""
    lines: list[str] = []
    # Whether each open condition is that of recording, and whether its lines are compiled.
    conditions: list[tuple[bool, bool]] = []
    for line in osl.splitlines(keepends=True):
        command = line.split()[:1]
        if command and command[0] in ("#if", "#ifdef", "#ifndef"):
            conditions.append((line.split() == ["#if", "RECORDED"], line.split() != ["#if", "RECORDED"]))
        own, _ = conditions[-1] if conditions else (False, True)
        if own and command == ["#else"]:
            conditions[-1] = (True, True)
        elif not (own and command in (["#if"], ["#endif"])) and all(kept for _, kept in conditions):
            lines.append(line)
        if command == ["#endif"]:
            conditions.pop()
    return "".join(lines)


def _guides(graph: Graph, lobes: Sequence[Lobe], deltas: Sequence[Delta]) -> dict[str, list[Any]]:
    """Return what the features are, by their names in the template: numbers in [0, 1]."""
    mixture = Mixture(lobes, symbols(graph, WO))
    albedo: Any = middle_albedo(mixture) if lobes else np.zeros(3)
    for delta in deltas:
        albedo = albedo + delta.value
    normal: Any = middle_normal(mixture) if lobes else ZENITH
    return {"feature_albedo": elements_of(np.clip(albedo, 0.0, 1.0)), "feature_normal": elements_of(normal)}


def _of_look(graph: Graph, layer: StackLayer) -> StackLayer:
    """Return a layer, its constants as uniforms."""
    # By identity: a parameter that follows another has the same object.
    found = {id(each): each for each in (*layer.parameters.values(), layer.mask)}
    found = {key: uniforms(graph, v) if isinstance(v, np.ndarray | float) else v for key, v in found.items()}
    parameters = {name: found[id(value)] for name, value in layer.parameters.items()}
    return replace(layer, parameters=parameters, mask=found[id(layer.mask)])


def _counts(where: str, brdf_samples: int, ibl_samples: int, transmits: bool) -> list[str]:
    """Define the numbers of directions; those of the light are divided among front and back."""
    back = ibl_samples // 2 if transmits else 0
    return [
        f"#define BRDF_SAMPLES{where} {brdf_samples}",
        f"#define FRONT_SAMPLES{where} {ibl_samples - back}",
        f"#define BACK_SAMPLES{where} {back}",
    ]
