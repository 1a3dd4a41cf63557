"""Only shaders that record light have the lines for it."""

import pytest

from lookdev.codegen.osl.surface import _remove_recording, generate_surface
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import LOBE_GROUPS, ShaderSource
from lookdev.light import Light, load_environment, prepare_light
from lookdev.light.rig import load_rig
from lookdev.material import Layer, Look
from lookdev.scene import Sampling
from lookdev.shipped import rig_file

TEXT = "a|#if RECORDED|b|#if X|c|#else|d|#endif|#else|e|#if X|f|#endif|#endif|#if X|g|#if RECORDED|h|#endif|#endif|"
VELVET = Look("velvet", (Layer("v", "disney", {"baseColor": (0.3, 0.1, 0.1), "sheen": 1.0}),))


def surface(lights: tuple[Light, ...], *passes: str) -> ShaderSource:
    groups = tuple(range(len(lights))) if passes else ()
    sampling = Sampling(bounces=1, passes=passes)
    return generate_surface(VELVET, SourceSetting(lights, (8, 8), sampling, light_groups=groups))


def test_conditions_of_other_names_stay() -> None:
    assert _remove_recording(TEXT.replace("|", "\n")) == "a\ne\n#if X\nf\n#endif\n#if X\ng\n#endif\n"


@pytest.mark.parametrize("rig", [False, True], ids=["dome", "rig"])
def test_what_records_nothing_has_no_line_for_it(rig: bool) -> None:
    lights = load_rig(rig_file("three_point")).lights if rig else (prepare_light(load_environment(builtin="white")),)
    plain = surface(lights)
    # The one line left defines that the shader does not record.
    lines = [line for line in plain.osl.splitlines() if "RECORDED" in line.upper() or "by_light" in line]
    assert lines == ["#define RECORDED 0"]
    assert plain.recorded == ()
    recorded = surface(lights, "lights")
    assert recorded.recorded == ("diffuse", "specular", "sheen")
    assert f"#define LIGHT_GROUPS {len(lights)}" in recorded.osl
    numbers = ", ".join(str(LOBE_GROUPS.index(group)) for group in recorded.recorded)
    assert f"#define RECORDED_LOBE_NUMBERS {{ {numbers} }}" in recorded.osl
