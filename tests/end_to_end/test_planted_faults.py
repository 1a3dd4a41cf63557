"""Faults planted in the shader that Cycles runs, and the least work with which each check finds them.

``python tests/end_to_end/test_planted_faults.py`` measures it in some minutes, and prints the table of docs/checks.md.
"""

import re
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np
import OpenImageIO as oiio
import pytest
from looks import quick_among
from usd_text import image, shader

from lookdev.brdf import StackLayer, stack_bsdf
from lookdev.checks.albedo import ANGLES
from lookdev.checks.check import DEPTHS, check_file
from lookdev.light import Dome, EnvironmentMap, prepare_light
from lookdev.reference.mesh import MeshScene
from lookdev.reference.render import Estimate, frame_pixels

DOCS = Path(__file__).parents[2] / "docs" / "checks.md"


def look_text(stack: str, *layers: str) -> str:
    """Return a look of layers, whose stack has these inputs."""
    head = '#usda 1.0\n( defaultPrim = "Look" )\ndef Material "Look"\n{\n'
    surface = "token outputs:lookdev:surface.connect = </Look/Layers.outputs:surface>\n"
    return f"{head}{surface}{shader('Layers', 'LookdevLayers', stack, 'token outputs:surface')}{''.join(layers)}}}\n"


def layer(name: str, model: str, color: str, **inputs: float) -> str:
    lines = [f"float inputs:{key} = {value}" for key, value in inputs.items()]
    return shader(name, f"Lookdev{model}", f"color3f inputs:{color}", *lines, "token outputs:layer")


# A texture, a mask and an anisotropic base; and constant layers that light passes through.
TEXTS = {
    "paint": look_text(
        """token inputs:base.connect = </Look/Base.outputs:layer>
        token inputs:layer1.connect = </Look/Dust.outputs:layer>
        float inputs:layer1Mask.connect = </Look/Map.outputs:g>
        token inputs:layer2.connect = </Look/Wax.outputs:layer>
        float inputs:layer2Mask = 0.3""",
        layer("Base", "Disney", "baseColor.connect = </Look/Map.outputs:rgb>",
              roughness=0.45, anisotropic=0.8, clearcoat=0.5),
        layer("Dust", "Disney", "baseColor = (0.6, 0.5, 0.4)", roughness=0.8),
        layer("Wax", "Disney", "baseColor = (0.4, 0.1, 0.05)", roughness=0.3),
        image("Look", "color.png", space="sRGB").replace("float outputs:r", "float outputs:g"),
    ),
    "lacquer": look_text(
        """token inputs:base.connect = </Look/Wood.outputs:layer>
        token inputs:layer1.connect = </Look/Varnish.outputs:layer>
        float inputs:layer1Mask = 0.8
        uniform token inputs:layer1Mode = "transmit\"""",
        layer("Wood", "Pixar", "surfaceColor = (0.5, 0.3, 0.1)", roughness=0.7, back=0.3),
        layer("Varnish", "Pixar", "surfaceColor = (0.9, 0.5, 0.2)", roughness=0.25, clear=0.9),
    ),
}  # fmt: skip

Stack = Sequence[StackLayer]

# Work of a check, from the least to its default depth: cases, views of one place, pixels.
WORK = {"points": (16, 64, 256, 1024, 4096, 16384, 40_000), "albedo": (1, 2, 4, 8), "image": (6, 12, 25, 50, 100)}
SEEDS = range(3)


def _instead(pattern: str, replacement: str | Callable[[re.Match[str]], str], count: int = 0) -> Callable[[str], str]:
    def alter(osl: str) -> str:
        changed, found = re.subn(pattern, replacement, osl, count=count)
        assert found, f"the shader has no '{pattern}'"
        return changed

    return alter


def _other_axis(line: re.Match[str]) -> str:
    return re.sub(r"\b(w[oi])_([xy])\b", lambda name: f"{name[1]}_{'y' if name[2] == 'x' else 'x'}", line[0])


def _restacked(change: Callable[[Stack], Stack]) -> Callable[[pytest.MonkeyPatch], None]:
    """Generate shaders from other layers; the reference combines the right ones."""

    def plant(patch: pytest.MonkeyPatch) -> None:
        # Sources in the cache are of the code as it is in its files.
        patch.setattr(
            "lookdev.rendering.scene.cached_source", lambda backend, look, setting, _: backend.generate(look, setting)
        )
        for module in ("points", "osl.surface"):
            patch.setattr(f"lookdev.codegen.{module}.stack_bsdf", lambda layers: stack_bsdf(change(layers)))

    return plant


def _mask_inverted(stack: Stack) -> Stack:
    base, layer, *rest = stack
    return [base, replace(layer, mask=1.0 - layer.mask), *rest]


def _swapped(stack: Stack) -> Stack:
    """Exchange the two upper layers, but for mask and mode."""
    *rest, lower, upper = stack
    return [*rest, replace(upper, mask=lower.mask, mode=lower.mode), replace(lower, mask=upper.mask, mode=upper.mode)]


def _light_mirrored(patch: pytest.MonkeyPatch) -> None:
    """Render the mirror image of a light; the reference has the light itself."""
    right: dict[Dome, Dome] = {}

    def prepare(light: EnvironmentMap) -> Dome:
        wrong = prepare_light(replace(light, radiance=light.radiance[:, ::-1], digest=f"{light.digest} mirrored"))
        right[wrong] = prepare_light(light)
        return wrong

    def reference(scene: MeshScene, lights: tuple[Dome, ...], *rest: Any, **options: int) -> Estimate:
        return frame_pixels(scene, [right[light] for light in lights], *rest, **options)

    patch.setattr("lookdev.checks.check.prepare_light", prepare)
    patch.setattr("lookdev.checks.check.frame_pixels", reference)


@dataclass(frozen=True)
class Fault:
    """A change of the shader's text by `alter`, or of the layers or the light it is made of by `plant`.

    `found` has the least work of `WORK` with which a check finds it, for all of `SEEDS`: inf, not at its default
    depth; a check without an entry cannot find it.
    """

    found: Mapping[str, float]
    alter: Callable[[str], str] = lambda osl: osl
    plant: Callable[[pytest.MonkeyPatch], None] = lambda patch: None
    look: str = "paint"


FAULTS = {
    "a cosine too many": Fault(
        {"points": 16, "albedo": 1, "image": 6},
        _instead(r"pdf = pdf / shares;", "pdf = pdf / shares; f *= fabs(wi_z);"),
    ),
    "pi missing": Fault({"points": 16, "albedo": 1, "image": 6}, _instead(r"0\.3183098861837907", "1.0", 1)),
    # Where directions enter the local frame, and where they leave it.
    "alpha_x and alpha_y swapped": Fault(
        {"points": 16, "albedo": 2, "image": inf}, _instead(r"\bw[oi]_[xy] = (?:cell|dot).*|\bwi = wi_x.*", _other_axis)
    ),
    "a lobe's pdf 2 % too large": Fault(
        {"points": 16, "albedo": 1, "image": inf}, _instead(r"pdf (\+?=) share_1 \*", r"pdf \1 1.02 * share_1 *")
    ),
    "the mask inverted": Fault({"points": 16, "albedo": 1, "image": 6}, plant=_restacked(_mask_inverted)),
    "the layers swapped": Fault({"points": 16, "albedo": 1, "image": 6}, plant=_restacked(_swapped)),
    "the layers swapped, in mode `transmit`": Fault(
        {"points": 16, "albedo": 1, "image": 6}, plant=_restacked(_swapped), look="lacquer"
    ),
    "the clearcoat lost at grazing views": Fault(
        {"points": 64, "image": inf}, _instead(r"if \(share_2 > 0\)", "if (share_2 > 0 && wo_z > 3e-4)")
    ),
    "the light mirrored": Fault({"image": 6}, plant=_light_mirrored),
    "a texture not linearised": Fault(
        {"image": 6}, _instead(r"(color texture0 = lookdev_texture\([^;]*;)", r"\1 texture0 = pow(texture0, 1 / 2.2);")
    ),
    "3 % of the light lost": Fault({"albedo": 1, "image": 25}, _instead(r"direct \+= ", "direct += 0.97 * ")),
}

CELLS = [(name, check) for name, fault in FAULTS.items() for check, work in fault.found.items() if work < inf]
QUICK = [("a cosine too many", "points"), ("3 % of the light lost", "albedo")]
NONE = {look: Fault({}, look=look) for look in ("paint", "lacquer")}


def write_looks(folder: Path) -> Path:
    rng = np.random.default_rng(5)
    assert oiio.ImageBuf(rng.integers(20, 230, (8, 8, 3)).astype(np.uint8)).write(str(folder / "color.png"))
    for name, text in TEXTS.items():
        (folder / f"{name}.usda").write_text(text)
    return folder


def agrees(looks: Path, fault: Fault, check: str, work: int | None = None, seed: int = 0) -> tuple[bool, str]:
    """Run one check with a fault planted, at its default depth or with `work`: whether it passed, and a report."""
    with pytest.MonkeyPatch.context() as patch:
        if work:
            angles = ANGLES[:: max(1, len(ANGLES) // work)]
            less = replace(DEPTHS["default"], cases=work, points=1, angles=angles, pixels=work)
            patch.setitem(DEPTHS, "default", less)
        fault.plant(patch)
        (finding,) = check_file(looks / f"{fault.look}.usda", only=[check], seed=seed, alter=fault.alter)
    return finding.passed, "\n".join((finding.summary, *finding.details))


def measured(looks: Path, fault: Fault) -> dict[str, float]:
    """Measure `Fault.found`."""

    def found(check: str, work: int) -> bool:
        return not any(agrees(looks, fault, check, work, seed)[0] for seed in SEEDS)

    return {check: next((work for work in WORK[check] if found(check, work)), inf) for check in fault.found}


def table(found: Mapping[str, Mapping[str, float]]) -> str:
    """Return the table of docs/checks.md, in Markdown."""
    units = {"points": "cases", "albedo": "views", "image": "pixels"}
    rows = ["| fault | points: cases | albedo: views | image: pixels |", "|---|---|---|---|"]
    for name, work in found.items():
        cells = ["-" if check not in work else "no" if work[check] == inf else f"{work[check]:,}" for check in units]
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


@pytest.fixture(scope="module")
def looks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_looks(tmp_path_factory.mktemp("planted"))


@pytest.mark.cycles
@pytest.mark.proof
@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize("check", WORK)
@pytest.mark.parametrize("look", NONE)
def test_without_a_fault_all_agrees(looks: Path, look: str, check: str) -> None:
    agreed, report = agrees(looks, NONE[look], check)
    assert agreed, report


@pytest.mark.cycles
@pytest.mark.usefixtures("warm")
@pytest.mark.parametrize(("name", "check"), quick_among(CELLS, QUICK))
def test_a_planted_fault_is_found(looks: Path, name: str, check: str) -> None:
    agreed, report = agrees(looks, FAULTS[name], check, int(FAULTS[name].found[check]))
    assert not agreed, report


def test_the_docs_have_the_table() -> None:
    rows = table({name: fault.found for name, fault in FAULTS.items()})
    assert f"<!-- planted faults -->\n{rows}<!-- end -->\n" in DOCS.read_text(), f"the table would be:\n{rows}"


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        written = write_looks(Path(folder))
        sys.stdout.write(table({name: measured(written, fault) for name, fault in FAULTS.items()}))
