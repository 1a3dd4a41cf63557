"""What Cycles' nodes look up of textures and their slopes is what the reference looks up."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from scripts import tree_pictures

from lookdev.brdf.parameters import Parameter
from lookdev.codegen import Link, NodeSource, NodeTree
from lookdev.codegen.inputs import Inputs
from lookdev.codegen.nodes.builder import TreeBuilder
from lookdev.codegen.nodes.inputs import bind_inputs
from lookdev.codegen.trace.graph import Graph, reachable
from lookdev.codegen.trace.symbolic import elements_of
from lookdev.material import Bump, Coordinates, Formula, Texture
from lookdev.material.expression import parse
from lookdev.material.textures import image_file, sample_slopes, sample_texture
from lookdev.material.values import Values

pytestmark = pytest.mark.cycles

WRAPS: tuple[Any, ...] = ("black", "clamp", "repeat", "mirror")
# The probe's square reaches from -1 to 1: coordinates from -2.3 to 2.9.
TRANSFORM = (2.0, 0.4, 0.1, -0.4, 2.2, 0.3)
# Light is not negative.
ABOVE = {"scale": (1.0,) * 4, "bias": (2.0,) * 4}
COLOR = Parameter("x", "color", (0.0, 0.0, 0.0), hard=(0.0, 1e3))


def picture(file: Path, seed: int) -> Path:
    pixels = np.random.default_rng(seed).uniform(-1.0, 2.0, (3, 5, 4)).astype(np.float32)
    assert oiio.ImageBuf(pixels).write(str(file))
    return file


def on_the_square(tree: NodeTree) -> NodeTree:
    """Let the place on the probe's square be the UV map, which it has none of."""
    nodes = []
    for node in tree.nodes:
        inputs = {
            socket: replace(value, socket="Position") if isinstance(value, Link) and value.socket == "UV" else value
            for socket, value in node.inputs.items()
        }
        kind = {"kind": "NewGeometry", "properties": {}} if node.kind == "UVMap" else {}
        nodes.append(replace(node, inputs=inputs, **kind))
    return replace(tree, nodes=tuple(nodes))


def emitting(source: Any) -> NodeSource:
    """Return a material that emits what a look would read."""
    inputs = Inputs(Graph(), image_file)
    if isinstance(source, Bump):
        x, y, _ = elements_of(Values(inputs)._bump(source) + 20.0)
        value = [x, y, 20.0]
    else:
        value = elements_of(Values(inputs).of(source, COLOR))
    builder = TreeBuilder("emitting")
    bind_inputs(builder, inputs, [str(node.args[0]) for node in reachable(value) if node.op == "symbol"])
    light = builder.add("Emission", inputs={"Color": builder.vector(value)})
    builder.add("OutputMaterial", inputs={"Surface": Link(light, "Emission")})
    return NodeSource("emitting", (on_the_square(builder.tree()),), (), "", False)


def test_cycles_looks_up_what_the_reference_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    file = picture(tmp_path / "picture.exr", 1)
    for seed, tile in enumerate((1001, 1002, 1012)):
        picture(tmp_path / f"set.{tile}.exr", seed)
    textures = {
        f"{s} {t} {channel}": Texture(file, channel, "raw", s, t, "st", TRANSFORM, **ABOVE)
        for s, t in itertools.product(WRAPS, WRAPS)
        for channel in ("rgb", "a")
    }
    textures["as it is"] = Texture(file, "rgb", "raw", **ABOVE)
    textures["tiles"] = Texture(tmp_path / "set.<UDIM>.exr", "rgb", "raw", transform=TRANSFORM, **ABOVE)
    bumps = {
        f"bump {s} {t}": Bump(Texture(file, "g", "raw", s, t, "st", TRANSFORM))
        for s, t in (*((wrap, wrap) for wrap in WRAPS), ("mirror", "clamp"))
    }
    place = Formula(parse("st + 2"), {"st": Coordinates("st")}, {"st": "color"})
    sources = {name: emitting(each) for name, each in {**textures, **bumps, "place": place}.items()}

    pictures = tree_pictures(sources, tmp_path)
    st = pictures["place"][..., :2].astype(np.float64) - 2.0
    # Coordinates of a few units, and values of a few, in float32; slopes between texels of about 10 a unit.
    for name, texture in textures.items():
        wanted = sample_texture(texture, st)
        wanted = wanted[..., None] * np.ones(3) if wanted.ndim == 2 else wanted
        np.testing.assert_allclose(pictures[name], wanted, rtol=0.0, atol=2e-5, err_msg=name)
    m = np.reshape(TRANSFORM, (2, 3))
    image = st @ m[:, :2].T + m[:, 2]
    # Away from the lines where slopes jump, at which the last digit of a coordinate decides.
    clear = (np.abs(image - np.round(image)) > 1e-5).all(axis=-1)
    for name, bump in bumps.items():
        wanted = 20.0 - sample_slopes(bump.height, st)
        np.testing.assert_allclose(pictures[name][clear, :2], wanted[clear], rtol=0.0, atol=3e-4, err_msg=name)
