"""The generated text has everything that a look needs, and nothing else."""

import hashlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from layers import DOME, surface

from lookdev.brdf import MODELS, complete_parameters
from lookdev.brdf.pixar.partition import REFLECTED_LOBES, TRANSMITTED_LOBES
from lookdev.cache import Content
from lookdev.codegen.osl.block import Block, literal
from lookdev.codegen.osl.bsdf import emit_brdf, trace_lobes
from lookdev.codegen.osl.points import generate_point_shader
from lookdev.codegen.points import PointLayer
from lookdev.codegen.source import HANDEDNESS, ShaderSource, short_name
from lookdev.codegen.templates import expand_template
from lookdev.codegen.trace.graph import Graph
from lookdev.codegen.trace.lobes import present_lobes
from lookdev.errors import CodegenError
from lookdev.light import Dome, SphereLight
from lookdev.material import Bump, Layer, Primvar, Texture

DISNEY = PointLayer("disney", {"variant": "2014"})
PIXAR = PointLayer("pixar", {"energy": "published"})


@pytest.fixture
def textures(tmp_path: Path) -> dict[str, Texture]:
    channels: dict[str, Any] = {"a": "rgb", "b": "rgb", "mask": "r"}
    for name in channels:
        (tmp_path / name).write_bytes(name.encode())
    return {name: Texture(tmp_path / name, channel, "raw") for name, channel in channels.items()}


def base(mask: Any = 1.0, **inputs: Any) -> Layer:
    return Layer("layer", "disney", inputs, mask)


def pixar(mask: Any = 1.0, mode: Any = "over", **inputs: Any) -> Layer:
    return Layer("layer", "pixar", inputs, mask, mode)


def generated(source: ShaderSource) -> str:
    """Return the shader without included files, whose comments do not name lobes."""
    return source.osl[source.osl.index("shader lookdev_") :]


def lobes_in(source: ShaderSource) -> set[str]:
    return {name for name in ("clearcoat", *REFLECTED_LOBES, *TRANSMITTED_LOBES) if f"// {name}\n" in source.osl}


def test_a_plain_look_has_no_clearcoat_and_no_sheen() -> None:
    plain, coated = surface(base()), surface(base(clearcoat=1.0))
    assert lobes_in(plain) == {"diffuse", "specular"}
    assert lobes_in(coated) == {"diffuse", "specular", "clearcoat"}
    for word in ("clearcoat", "expm1", "log("):  # GTR1 alone takes logarithms
        assert word not in generated(plain)
    assert "expm1" in generated(coated)
    assert surface(base(sheen=0.0, sheenTint=1.0)).osl == plain.osl
    assert lobes_in(surface(base(metallic=1.0))) == {"specular"}
    # As published, Schlick's term rises to 1 for every F0.
    assert lobes_in(surface(base(specular=0.0))) == {"diffuse", "specular"}


def test_a_diffuse_lobe_alone_has_nothing_of_the_others() -> None:
    code = generated(generate_point_shader([DISNEY], ("diffuse",)))
    code = "\n".join(
        line for line in code.splitlines() if "cell[" not in line and not re.match(r" +float layer0_\w+ = 0;", line)
    )
    inputs = ("layer0_clearcoat", "layer0_specular", "layer0_anisotropic")
    for word in (*inputs, "specular\n", "clearcoat\n", "log(", "expm1("):
        assert word not in code, word
    everything = generated(generate_point_shader([DISNEY]))
    for word in ("layer0_clearcoat", "layer0_anisotropic", "log("):
        assert word in everything, word


def test_a_constant_diffuse_has_no_sheen_and_no_subsurface() -> None:
    def evaluation(**inputs: Any) -> str:
        graph, bsdf = Graph(), MODELS["disney"].bsdf(complete_parameters("disney", inputs))
        diffuse = [lobe for lobe in present_lobes(graph, bsdf) if lobe.name == "diffuse"]
        return "\n".join(emit_brdf(trace_lobes(graph, diffuse)).evaluate)

    def operations(code: str) -> int:
        return len(re.findall(r" [-+*/] ", code))

    plain = evaluation()
    assert evaluation(sheen=0.0, sheenTint=1.0, subsurface=0.0) == plain
    # Subsurface alone divides by the sum of the cosines; the half vector's length is divided by once.
    assert plain.count("/") == evaluation(sheen=0.5).count("/") == evaluation(subsurface=0.5).count("/") - 1
    assert operations(evaluation(sheen=0.5)) > operations(plain)
    # With roughness 0 the diffuse shape needs no half vector; sheen does.
    assert "sqrt" not in evaluation(roughness=0.0)
    assert "sqrt" in evaluation(roughness=0.0, sheen=0.5)


def test_a_texture_times_0_vanishes(textures: dict[str, Texture]) -> None:
    nothing = replace(textures["mask"], scale=(0.0,) * 4)
    assert surface(base(clearcoat=nothing)) == surface(base(clearcoat=0.0))
    assert surface(base(), base(nothing, baseColor=textures["a"])) == surface(base())


def test_what_both_layers_share_stays_constant(textures: dict[str, Texture]) -> None:
    source = surface(base(metallic=1.0, roughness=0.1), base(textures["mask"], metallic=1.0, roughness=0.4))
    assert lobes_in(source) == {"specular"}


def test_a_texture_only_a_dropped_lobe_reads_is_not_bound(textures: dict[str, Texture]) -> None:
    assert surface(base(clearcoat=0.0, clearcoatGloss=textures["mask"])).textures == ()


def test_one_image_read_twice_is_one_look_up(textures: dict[str, Texture]) -> None:
    red, green = (replace(textures["a"], channel=channel) for channel in ("r", "g"))
    source = surface(base(roughness=red, metallic=green, baseColor=textures["a"]))
    assert generated(source).count("lookdev_texture(") == 1
    elsewhere = replace(red, transform=(2.0, 0.0, 0.0, 0.0, 2.0, 0.0))
    assert generated(surface(base(roughness=red, metallic=elsewhere))).count("lookdev_texture(") == 2


def test_a_lobe_that_may_be_absent_is_guarded(textures: dict[str, Texture]) -> None:
    for layer, lobe in (
        (base(clearcoat=textures["mask"]), "clearcoat"),
        (pixar(roughness=0.2, clear=textures["mask"]), "refraction"),
    ):
        code = surface(layer).osl
        (number,) = re.findall(rf"share_(\d) = .*// {lobe}", code)
        assert f"if (share_{number} > 0) {{  // {lobe}" in code
    # A lobe that is present everywhere needs no guard.
    assert "\n        {  // diffuse" in surface(base(clearcoat=textures["mask"])).osl


def test_run_time_values_are_clipped_to_the_hard_range(textures: dict[str, Texture]) -> None:
    assert "max(texture0[0], 0.0)" in surface(base(roughness=textures["mask"])).osl
    assert "max(primvar_wear, 0.0)" in surface(base(roughness=Primvar("wear", 0.5))).osl


def test_primvars_are_bound() -> None:
    source = surface(base(roughness=Primvar("my:wear", 0.5), baseColor=Primvar("displayColor", (1.0, 0.5, 0.0))))
    kinds = {binding.attribute: (binding.parameter, binding.kind, binding.fallback) for binding in source.attributes}
    assert kinds == {
        "my:wear": (f"primvar_{short_name('my:wear')}", "float", (0.5,)),
        "displayColor": ("primvar_displayColor", "color", (1.0, 0.5, 0.0)),
    }


# Inputs with which a Pixar layer has all lobes.
FULL = {"roughness": 0.2, "clear": 0.5, "back": 0.5}
HIGHLIGHTS = {"specular", "reflection", "specularTransmission", "refraction"}


@pytest.mark.parametrize(
    ("inputs", "lost"),
    [
        ({}, set()),
        ({"clear": 0.0}, {"specularTransmission", "refraction"}),
        ({"clear": 1.0}, set()),  # roughness scatters
        ({"clear": 1.0, "roughness": 0.0}, {"diffuse", "diffuseTransmission", "specular", "specularTransmission"}),
        ({"back": 0.0}, {"diffuseTransmission"}),
        ({"back": 1.0}, {"diffuse"}),
        ({"roughness": 0.0}, {"specular", "specularTransmission"}),
        ({"roughness": 0.5}, {"reflection", "refraction"}),
        ({"roughness": 1.0}, HIGHLIGHTS),
        ({"specularTint": (0.0, 0.0, 0.0)}, {"specular", "reflection"}),
        ({"transmissionTint": (0.0, 0.0, 0.0)}, {"specularTransmission", "refraction"}),
        ({"surfaceColor": (0.0, 0.0, 0.0)}, {"diffuse", *TRANSMITTED_LOBES}),
        ({"presence": 0.0}, {*REFLECTED_LOBES, *TRANSMITTED_LOBES}),
        *(({f"{name}Scale": 0.0}, {name}) for name in (*REFLECTED_LOBES, *TRANSMITTED_LOBES)),
    ],
    ids=lambda value: str(sorted(value) if isinstance(value, set) else value),
)
def test_a_pixar_lobe_without_weight_vanishes(inputs: dict[str, Any], lost: set[str]) -> None:
    source = surface(pixar(**FULL | inputs))
    assert lobes_in(source) == {*REFLECTED_LOBES, *TRANSMITTED_LOBES} - lost
    assert source.transmits == bool(lobes_in(source) & set(TRANSMITTED_LOBES))
    assert source.see_through == ("presence" in inputs)


@pytest.mark.parametrize("energy", ["published", "conserving"])
def test_a_stack_has_the_lobes_that_its_interactions_leave(energy: str) -> None:
    wood = pixar(roughness=1.0, energy=energy)
    glass = {"roughness": 0.0, "clear": 1.0, "energy": energy}
    assert lobes_in(surface(wood)) == {"diffuse"}
    # In mode "over", a lacquer still transmits light to the other side; in mode "transmit", that light meets the wood.
    assert lobes_in(surface(wood, pixar(0.5, **glass))) == {"diffuse", "reflection", "refraction"}
    assert lobes_in(surface(wood, pixar(1.0, "transmit", **glass))) == {"diffuse", "reflection"}
    # Light through glass on frosted glass scatters as by frosted glass.
    frosted = pixar(roughness=0.5, clear=1.0, diffuseScale=0.0, energy=energy)
    expected = {"reflection", "specular", "specularTransmission"}
    assert lobes_in(surface(frosted, pixar(1.0, "transmit", **glass))) == expected


def test_only_a_leaning_normal_has_a_frame(textures: dict[str, Texture]) -> None:
    straight = surface(pixar(**FULL))
    assert surface(pixar(**FULL, diffuseNormal=(0.0, 0.0, 1.0))).osl == straight.osl
    assert surface(pixar(**FULL, highlightNormal=(0.0, 0.0, 0.5))).osl == straight.osl
    bumped = Bump(replace(textures["mask"], channel="r"), 0.1)
    # A lobe that is not there reads no normal.
    assert surface(pixar(roughness=1.0, highlightNormal=bumped)).textures == ()
    leaning = surface(pixar(roughness=1.0, diffuseNormal=bumped))
    assert leaning.images == (Content.store_copy(textures["mask"].file),)
    assert HANDEDNESS in {binding.attribute for binding in leaning.attributes}


def test_options_at_their_defaults_and_normals_that_are_the_same_have_no_code(textures: dict[str, Texture]) -> None:
    bumped = Bump(textures["mask"], 0.1)
    plain = surface(base(clearcoat=1.0, normal=bumped))
    normals = dict.fromkeys(("specularNormal", "clearcoatNormal"), bumped)
    assert surface(base(clearcoat=1.0, normal=bumped, gamma=2.0, **normals)).osl == plain.osl
    assert surface(base(clearcoat=1.0, normal=bumped, specularNormal=(0.0, 0.0, 1.0))).osl != plain.osl
    assert "pow(" in surface(base(gamma=1.5)).osl
    assert "pow(" not in surface(base()).osl


def test_layers_of_two_models_are_in_one_shader(textures: dict[str, Texture]) -> None:
    source = surface(base(metallic=1.0), pixar(textures["mask"], roughness=1.0, back=0.5))
    assert lobes_in(source) == {"specular", "diffuse", "diffuseTransmission"}
    assert source.transmits


def test_presence_is_seen_through(textures: dict[str, Texture]) -> None:
    assert not surface(pixar()).see_through
    source = surface(pixar(presence=0.25))
    assert source.constants[int(re.search(r"float presence = look_(\d+);", source.osl)[1])] == 0.25
    assert surface(pixar(presence=textures["mask"])).see_through
    # A hole in a layer over an opaque base shows the base.
    assert not surface(pixar(), pixar(presence=textures["mask"])).see_through


def test_a_primvar_with_two_fallbacks_is_reported() -> None:
    with pytest.raises(CodegenError, match="'wear' is read both as float and as float, or with two fallbacks"):
        surface(base(roughness=Primvar("wear", 0.5), metallic=Primvar("wear", 0.1)))


@pytest.mark.parametrize("bounces", [pytest.param(0, marks=pytest.mark.proof), 2])
def test_no_literal_is_nan_or_infinite(textures: dict[str, Texture], bounces: int) -> None:
    lacquer = pixar(0.5, "transmit", **FULL)
    for layers in (
        [base(roughness=0.0, anisotropic=1.0, clearcoat=1.0, clearcoatGloss=0.0, baseColor=(0.0, 0.0, 0.0))],
        [base(baseColor=textures["a"], clearcoat=textures["mask"], subsurface=1.0, sheen=1.0, sheenTint=1.0)],
        [base(variant="2012", metallic=1.0, baseColor=(0.0, 0.0, 0.0), specular=0.0)],
        [pixar(roughness=0.0, surfaceColor=(0.0, 0.0, 0.0), ior=1.0, presence=0.0)],
        [pixar(roughness=textures["mask"], clear=1.0, highlightNormal=(1.0, 0.0, -1.0)), lacquer],
    ):
        assert not re.search(r"\b(nan|inf)\b", surface(*layers, bounces=bounces).osl)
    for layers in ([DISNEY], [PIXAR], [PIXAR, replace(PIXAR, mode="transmit"), DISNEY]):
        assert not re.search(r"\b(nan|inf)\b", generate_point_shader(layers).osl)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_constant_that_is_not_finite_is_reported(value: float) -> None:
    with pytest.raises(CodegenError, match="the model leaves its domain"):
        literal(value)


@pytest.mark.parametrize(("value", "text"), [(True, "1"), (False, "0"), (0.1, "0.1"), (-2.0, "-2.0"), (1e-18, "1e-18")])
def test_literals(value: float, text: str) -> None:
    assert literal(value) == text


def test_what_is_used_twice_has_a_name_and_a_condition_is_an_integer() -> None:
    graph = Graph()
    x = graph.symbol("x")
    twice, condition = graph.apply("sqrt", x), graph.apply("greater", x, 0.5)
    product = graph.apply("multiply", twice, twice)
    block = Block("s", indent=1)
    block.prepare([product])
    assert (block.expression(product), block.name(condition)) == ("(s0 * s0)", "s1")
    assert block.lines == ["    float s0 = sqrt(x);", "    int s1 = x > 0.5;"]


def light_sampled_in(source: ShaderSource) -> set[str]:
    """Return the light-sampled lobes of a shader."""
    sample = source.osl[source.osl.index("sobol_2d(index") : source.osl.index("wi = wi_x * t")]
    return {part.split("\n")[0] for part in sample.split("{  // ")[1:] if "light_sampled = 1;" in part}


def test_broad_lobes_are_light_sampled() -> None:
    coated = base(clearcoat=1.0)
    assert light_sampled_in(surface(coated)) == {"diffuse"}
    code = surface(coated).osl
    assert "#define LIGHT_SAMPLED 1" in code
    # The other lobes have a weight against the light's directions, all lobes against each other.
    assert code.count("bsdf_sampled_pdf += own_pdf;") == 2
    assert len(re.findall(r" pdf \+= ", code)) == 3
    constant = surface(coated, lights=(replace(DOME, constant=True),))
    for without in (surface(coated, ibl_samples=0), constant, surface(base(metallic=1.0))):
        assert not light_sampled_in(without)
        assert "#define LIGHT_SAMPLED 0" in without.osl
        assert "bsdf_sampled_pdf += " not in without.osl


def counts(source: ShaderSource) -> list[int]:
    """Return the directions of BSDF and light at the first hit, and after a bounce."""
    names = [f"{name}_SAMPLES{where}" for where in ("", "_ONWARD") for name in ("BRDF", "FRONT", "BACK")]
    (values,) = zip(*(re.findall(rf"#define {name} (\d+)\n", source.osl) for name in names), strict=True)
    brdf, front, back, *onward = map(int, values)
    return [brdf, front + back, onward[0], onward[1] + onward[2]]


def test_directions_are_few_at_the_first_hit_of_glossy_looks_in_recesses(textures: dict[str, Texture]) -> None:
    def counts_of(layer: Layer, light: Dome | SphereLight = DOME, **options: int) -> list[int]:
        automatic: dict[str, Any] = {"brdf_samples": None, "ibl_samples": None, "bounces": 2}
        return counts(surface(layer, lights=(light,), **automatic | options))

    # Metals are glossy for any roughness and anisotropy.
    rough = replace(textures["mask"], scale=(0.5,) * 4)
    metals = base(metallic=1.0), base(metallic=1.0, anisotropic=0.8), base(metallic=1.0, roughness=rough)
    for metal in metals:
        assert counts_of(metal) == [2, 2, 1, 4]
        assert counts_of(metal, SphereLight.example()) == [2, 2, 1, 4]
        assert counts_of(metal, bounces=0) == [4, 4, 1, 2]
        assert counts_of(metal, brdf_samples=8) == [8, 4, 2, 2]
        assert counts_of(metal, replace(DOME, constant=True)) == [4, 0, 1, 0]
    # If a lobe is broad, or light comes from both sides, the numbers are larger.
    for layer in (base(), base(metallic=textures["mask"]), pixar(clear=0.5, roughness=0.4)):
        assert counts_of(layer) == [4, 4, 1, 2]


def test_lobes_that_transmit_are_light_sampled_if_there_are_directions_from_behind_at_every_depth() -> None:
    leaf = pixar(back=0.5, roughness=0.4)
    few, more = surface(leaf, ibl_samples=2), surface(leaf, ibl_samples=3)
    assert "#define BACK_SAMPLES_ONWARD 0" in few.osl
    assert "#define BACK_SAMPLES_ONWARD 1" in more.osl
    assert light_sampled_in(few) < light_sampled_in(more)
    assert len(light_sampled_in(more)) == 2


def test_an_opaque_surface_that_leans_is_lit_from_the_front() -> None:
    opaque, clear = (surface(pixar(highlightNormal=(0.3, 0.0, 1.0), clear=clear)).osl for clear in (0.0, 0.5))
    assert "#define TRANSMITS 0" in opaque
    assert "#define TRANSMITS 1" in clear
    # Points are evaluated on both sides, where the lobes are not 0.
    opaque_points = {"clear": 0.0, "back": 0.0, "diffuseNormal": (0.0, 0.0, 1.0)}
    for normal, transmits in (((0.0, 0.0, 1.0), 0), ((0.3, 0.0, 1.0), 1)):
        points = generate_point_shader([replace(PIXAR, constants=opaque_points | {"highlightNormal": normal})])
        assert f"#define TRANSMITS {transmits}\n" in points.osl


def test_shadow_rays_are_a_setting() -> None:
    shadowed, unshaded = (surface(base(), bounces=0, shadows=shadows) for shadows in (True, False))
    assert shadowed.shadows
    assert not unshaded.shadows
    assert "#define SHADOWS 1" in shadowed.osl
    assert "#define SHADOWS 0" in unshaded.osl


def test_an_unknown_section_is_reported() -> None:
    with pytest.raises(CodegenError, match=r"no section 'constants' for the template points.osl"):
        expand_template("points.osl", {})


def test_the_digest_names_text_and_content(textures: dict[str, Texture]) -> None:
    source = surface(base(baseColor=textures["a"]))
    assert surface(base(baseColor=textures["a"])) == source
    assert surface(base(baseColor=textures["a"], roughness=0.4)).digest != source.digest
    assert surface(base(baseColor=textures["a"]), bounces=2).digest != source.digest
    textures["a"].file.write_bytes(b"other content")
    other = surface(base(baseColor=textures["a"]))
    assert other.osl == source.osl
    assert other.digest != source.digest


def test_the_digest_names_what_a_missing_primvar_is() -> None:
    first, second = (surface(base(roughness=Primvar("wear", value))) for value in (0.5, 0.6))
    assert first.osl == second.osl
    assert first.digest != second.digest


def test_the_digest_of_points_is_that_of_their_text() -> None:
    source = generate_point_shader([DISNEY])
    assert source.digest == hashlib.sha256(source.osl.encode()).hexdigest()
    assert source.digest != generate_point_shader([replace(DISNEY, tokens={"variant": "2012"})]).digest


def test_names_that_have_a_meaning_in_cycles_or_here_are_not_kept():
    for name in ("generated", "tangent", "density", "color", "uv", "position", "lookdev_tangent", short_name("m" * 80)):
        assert short_name(name) != name
    assert short_name("st") == "st"


def test_the_diffuse_part_is_summed_by_itself_on_request() -> None:
    graph = Graph()
    lobes = present_lobes(graph, MODELS["disney"].bsdf(complete_parameters("disney", {"clearcoat": 1.0})))
    traced = trace_lobes(graph, lobes)
    assert [lobe.name for lobe in traced.lobes if lobe.is_diffuse] == ["diffuse"]
    assert "f_diffuse" not in "\n".join(emit_brdf(traced).evaluate)
    split = emit_brdf(traced, splits_diffuse=True).evaluate
    assert sum("f_diffuse += own_f;" in line for line in split) == 1
    assert sum("f += own_f;" in line or "f += color(" in line for line in split) == len(lobes)
