"""Generate the surface shader of a look, OSL that computes the reflected light itself, for backend ``exact``.

The hand-written template `lookdev/shaders/surface.osl` estimates the light integral. The generated code of the BSDF, of
the look's inputs and of the lights completes it.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from lookdev.brdf import Lobe
from lookdev.brdf.mixture import Mixture
from lookdev.codegen.inputs import SymbolicSurface
from lookdev.codegen.osl.bsdf import emit_brdf, trace_lobes
from lookdev.codegen.osl.catching import catching_sections
from lookdev.codegen.osl.frame import emit_frame
from lookdev.codegen.osl.inputs import ShaderNames, emit_look_up
from lookdev.codegen.osl.light import light_sections
from lookdev.codegen.osl.tables import bind_tables
from lookdev.codegen.program.look import trace_look
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import FIRST_LIGHT_PART, HANDEDNESS, LOBE_GROUPS, TANGENT_BINDING, ShaderSource
from lookdev.codegen.templates import expand_template
from lookdev.codegen.trace.azimuth import depends_on_tangent
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import WO, continuous_lobes, folded_lobe_count, present_deltas, trace_features
from lookdev.codegen.trace.symbolic import elements_of, symbols
from lookdev.light import Light, coded_light, lights_code
from lookdev.light.lamps import CodedRig
from lookdev.material import Look
from lookdev.scene.shading import LIFT

# The OSL type of a mesh attribute, by `AttributeBinding.kind`.
_OSL_TYPE = {"uv": "vector", "float": "float", "color": "color", "vector": "vector"}

# The number of directions drawn at a shading point from the BSDF, and also the number drawn from the light, unless the
# job or the look's lobes decide otherwise.
_DIRECTIONS = 4

# The factors, without and with bounces, by which a broad lobe's share of the directions drawn from the BSDF is reduced.
# The lobe's direct light is estimated by directions drawn from the light. The lobe needs directions drawn from the BSDF
# only for light that the asset reflects. Smaller factors are not better (docs/bench.md).
_BROAD_SHARES = (0.05, 0.3)

# A bound in 1/sr. If the BSDF's pdf and values in a direction drawn from the light are smaller, Russian roulette
# decides whether a ray is traced in this direction. The roulette does not raise the error of a metal. A higher bound
# does not save more time (docs/bench.md).
_MIN_TRACED_PDF = 0.01


@dataclass(frozen=True)
class DirectionCounts:
    """The numbers of directions that are drawn at a shading point.

    At the first hit, `brdf` directions are drawn from the BSDF, and `ibl` from the light. At later hits of a path, the
    numbers are `brdf_onward` and `ibl_onward`.
    """

    brdf: int
    ibl: int
    brdf_onward: int
    ibl_onward: int


def generate_surface(
    look: Look, setting: SourceSetting, replacements: Mapping[str, Sequence[str]] = MappingProxyType({})
) -> ShaderSource:
    """Generate the surface shader of a look.

    Parameters
    ----------
    look
        The look. Its constants are folded. Textures that only absent lobes read are not looked up.
    setting
        The lights, the sampling and the picture.
    replacements
        Lines that replace sections of the template, by the sections' names. The benchmark omits parts of the shader in
        this way.
    """
    sampling, lights = setting.sampling, setting.lights
    features, recorded, bounces = sampling.features, sampling.records_parts, sampling.bounces
    graph = Graph()
    inputs = SymbolicSurface(graph, setting.image_file)
    bsdf = trace_look(look, inputs, setting.space)
    lobes = continuous_lobes(graph, bsdf)
    deltas = present_deltas(graph, bsdf)
    constant = all(light.constant for light in lights)
    samples_light = sampling.ibl_samples != 0 and not constant
    counts = _direction_counts(lobes, sampling.brdf_samples, sampling.ibl_samples, bounces, constant_light=constant)
    # If only one direction is drawn from the light, it is for light from the front, and none is for light from behind.
    from_behind = min(counts.ibl, counts.ibl_onward) > 1
    if samples_light:
        share = _BROAD_SHARES[bounces > 0]
        lobes = [replace(lobe, share=lobe.share * share) if lobe.broad else lobe for lobe in lobes]
    transmits = any(lobe.transmits for lobe in lobes)

    def light_sampled(lobe: Lobe) -> bool:
        """Return whether the lobe's direct light is estimated by directions drawn from the light alone."""
        behind = lobe.transmits or (transmits and lobe.crosses_surface)
        return counts.ibl > 0 and lobe.broad and (from_behind or not behind)

    traced = trace_lobes(graph, lobes, light_sampled, recorded=recorded)
    names = ShaderNames(inputs)
    rig = None if coded_light(lights) else CodedRig.from_lights(lights)
    has_factors = rig is not None and rig.needs("split")
    guides = {}
    if features:
        albedo, normal = trace_features(Mixture(continuous_lobes(graph, bsdf), symbols(graph, WO)), deltas)
        guides = {"feature_albedo": elements_of(albedo), "feature_normal": elements_of(normal)}
    presence = elements_of(bsdf.presence)[0]
    code = emit_brdf(
        traced,
        presence,
        symbol_text=names.symbol_text,
        splits_diffuse=has_factors,
        recorded=recorded,
        deltas=deltas,
        features=guides,
    )
    deltas_transmit = any(delta.transmits for delta in deltas)
    reads_tangent = depends_on_tangent(graph, lobes)
    attributes = [*inputs.attributes_read_by(code.inputs), *[TANGENT_BINDING] * reads_tangent]
    bends_normals = any(binding.attribute == HANDEDNESS for binding in attributes)
    look_up_code = [emit_look_up(name, inputs.look_up(source)) for source, name in names.texture_names.items()]
    file_bindings = tuple(binding for _, bindings in look_up_code for binding in bindings)
    table_parameters, tables = bind_tables(code.tables)
    light_code = light_sections(lights)
    light_groups = _groups_in_shader_order(lights, setting.light_groups)
    recording_lines = _recording_lines(code.groups, light_groups) if recorded else []
    osl = expand_template(
        "surface.osl",
        {
            **light_code,
            "constants": [
                *light_code["constants"],
                f"#define IBL_SAMPLES {counts.ibl}",
                *_count_lines("", counts.brdf, counts.ibl, code.transmits),
                *_count_lines("_ONWARD", counts.brdf_onward, counts.ibl_onward, code.transmits),
                f"#define LIGHT_SAMPLED {int(code.light_sampled)}",
                f"#define LEAST_DENSITY {_MIN_TRACED_PDF}",
                *(f"#define {name} {value}" for name, value in sampling.shader_constants.items()),
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
                *recording_lines,
                *lights_code(lights, sampled=counts.ibl > 0).constants,
                f"#define DIRECTED {int(reads_tangent)}",
                f"#define LEANING {int(bends_normals)}",
            ],
            "parameters": [
                *(f'    string {binding.parameter} = "",' for binding in file_bindings),
                *table_parameters,
                *(f"    {_OSL_TYPE[attribute.kind]} {attribute.parameter} = 0," for attribute in attributes),
            ],
            **catching_sections(setting.catching),
            "frame": emit_frame(reads_tangent=reads_tangent, bends_normals=bends_normals),
            "inputs": [f"    {line}" for lines, _ in look_up_code for line in lines],
            **code.sections,
            **replacements,
        },
    )
    if not recorded:
        osl = _remove_recording(osl)
    constants = tuple(names.constants)
    hashed = [osl, repr(constants), *(binding.file.digest for binding in file_bindings), *map(repr, attributes)]
    return ShaderSource(
        look.name,
        osl,
        file_bindings,
        tuple(attributes),
        hashlib.sha256("".join(hashed).encode()).hexdigest(),
        transmits=code.transmits or deltas_transmit,
        see_through=code.see_through,
        directions=(counts.brdf, counts.ibl),
        shadows=setting.shadows,
        tables=tables,
        constants=constants,
        recorded=code.groups if recorded else (),
        folded=folded_lobe_count(graph, bsdf),
        catching=setting.catching,
    )


def _groups_in_shader_order(lights: Sequence[Light], groups: Sequence[int]) -> list[int]:
    """Return the groups of the lights, in the order in which the shader numbers lights; without groups, all are 0."""
    light_groups = groups or [0] * len(lights)
    if coded_light(lights):
        return list(light_groups)
    rig = CodedRig.from_lights(lights)
    numbers = {id(light): number for number, light in enumerate(lights)}
    return [light_groups[numbers[id(light)]] for light in (*rig.lamps, *rig.domes)]


def _recording_lines(lobes: Sequence[str], lights: Sequence[int]) -> list[str]:
    """Return the lines that define which groups of lobes and of lights are recorded.

    `lobes` are the names of groups in `LOBE_GROUPS`, `lights` the group of each light.
    """
    numbers = [LOBE_GROUPS.index(name) for name in lobes] or [-1]  # a black look has no groups
    return [
        f"#define FIRST_LIGHT_PART {FIRST_LIGHT_PART}",
        f"#define RECORDED_LOBES {len(numbers)}",
        f"#define RECORDED_LOBE_NUMBERS {{ {', '.join(map(str, numbers))} }}",
        f"#define RECORDED_LIGHTS {len(lights)}",
        f"#define LIGHT_GROUP_NUMBERS {{ {', '.join(map(str, lights))} }}",
        f"#define LIGHT_GROUPS {max(lights) + 1}",
    ]


def _remove_recording(osl: str) -> str:
    """Return a shader without the lines that are compiled only if ``RECORDED`` is 1.

    The digest of a shader that does not record then does not depend on these lines.
    """
    lines: list[str] = []
    # For each open #if: whether its condition is RECORDED, and whether its present branch is compiled.
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


def _count_lines(suffix: str, brdf_samples: int, ibl_samples: int, transmits: bool) -> list[str]:
    """Return the lines that define the numbers of directions, as macros whose names end with `suffix`.

    If the look `transmits`, directions drawn from the light are divided between the surface's front and back.
    """
    back = ibl_samples // 2 if transmits else 0
    return [
        f"#define BRDF_SAMPLES{suffix} {brdf_samples}",
        f"#define FRONT_SAMPLES{suffix} {ibl_samples - back}",
        f"#define BACK_SAMPLES{suffix} {back}",
    ]


# The numbers 2, 2, 1 and 4 are for a look whose lobes are all glossy. On a shape with recesses, most of the variance is
# in light that other parts of the shape reflect. A path that continues adds one sample of this light, whatever number
# of directions was drawn at its first hit. So the first hit draws few directions, and paths cost less. Later hits draw
# more directions from the light, since few of these fall into a narrow lobe. A broad lobe takes its direct light from
# all directions drawn from the light. The measurements are in docs/bench.md, "Recesses".
def _direction_counts(
    lobes: Sequence[Lobe], brdf: int | None, ibl: int | None, bounces: int, *, constant_light: bool
) -> DirectionCounts:
    """Return the numbers of directions for a look with these lobes.

    `brdf` and `ibl` are the numbers in the job, or None where the lobes decide. `constant_light` is whether all lights
    have constant radiance.
    """
    if not lobes:
        return DirectionCounts(1, 0, 1, 0)
    if constant_light:
        # Every direction is equally bright: samples of the light reduce no variance, even if a job sets some.
        return _counts_with_bounces(brdf or _DIRECTIONS, 0)
    if bounces > 0 and brdf is None and ibl is None and not any(lobe.broad or lobe.transmits for lobe in lobes):
        return DirectionCounts(2, 2, 1, 4)
    broad = bounces == 0 and all(lobe.broad for lobe in lobes)
    brdf = (0 if broad else _DIRECTIONS) if brdf is None else brdf
    ibl = _DIRECTIONS if ibl is None else ibl
    # Keep at least one sampling strategy.
    return _counts_with_bounces(brdf, ibl) if brdf + ibl else _counts_with_bounces(1, 0)


def _counts_with_bounces(brdf: int, ibl: int) -> DirectionCounts:
    """Return `brdf` and `ibl` as the numbers at the first hit, and smaller numbers after a bounce.

    Fewer directions suffice after a bounce, because every path adds a sample there. At least one direction is drawn
    from the BSDF, because the path continues along it.
    """
    return DirectionCounts(brdf, ibl, max(1, brdf // 4), -(-ibl // 2))
