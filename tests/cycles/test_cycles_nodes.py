"""Native nodes in Cycles: pictures of hand-written ones and of looks, and errors for those that Cycles cannot show."""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import node_sources
import numpy as np
import pytest
from frames import POSE, RenderScene, orbit_camera
from looks import LOOKS, quick_among
from warm_blender import BlenderProcess

from lookdev.asset import Asset, load_asset, save_asset
from lookdev.cache import Content
from lookdev.codegen.source import GeneratedSource, NodeLink, NodeSource, NodeTree, PrincipledSource, ShaderNode
from lookdev.errors import RenderError
from lookdev.light import Dome
from lookdev.material import Layer
from lookdev.material.usd import read_look
from lookdev.metrics import relmse
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import SceneTask, frame_task
from lookdev.rendering.worker import Worker
from lookdev.scene import Pose, Sampling

pytestmark = pytest.mark.cycles

GREY = (0.5, 0.4, 0.3)
RenderSource = Callable[..., WorkerFrame]


@pytest.fixture(scope="module")
def shoot(worker: Worker) -> RenderSource:
    """Return a function that renders a built-in asset with a source in all its slots."""

    @cache
    def load_stored(name: str) -> tuple[Asset, Content]:
        asset = load_asset(builtin=name)
        return asset, Content.store_copy(save_asset(asset))

    def render_one(
        name: str, source: GeneratedSource, light: Dome, *, pose: Pose = POSE, device: str = "cpu", **options: Any
    ) -> WorkerFrame:
        asset, file = load_stored(name)
        sampling = Sampling(**{"samples": 64, "bounces": 0} | options)
        camera = orbit_camera(asset.center, asset.radius)
        slot_sources = (0,) * len(asset.slots)
        exact = isinstance(source, NodeSource) and source.exact
        backend = "principled" if isinstance(source, PrincipledSource) else "nodes-exact" if exact else "nodes"
        scene = SceneTask(file, backend, (source,), slot_sources, (light,), (48, 48), sampling, camera, device)
        worker.start()
        return worker.render(frame_task(scene, pose, "frame"), lambda progress: None)

    return render_one


def halves(frame: WorkerFrame) -> Any:
    return frame.a.astype(np.float64), frame.b.astype(np.float64)


def mean(frame: WorkerFrame) -> Any:
    return sum(halves(frame)) / 2.0


def test_white_light_on_a_diffuse_surface_is_its_colour(shoot: RenderSource, light_of) -> None:
    frame = shoot("sphere", node_sources.diffuse(GREY), light_of("white"))
    filled = mean(frame)[frame.alpha == 1.0]
    assert len(filled) > 800
    # Every direction weighs the same. Facets hide the few that are below their horizon from the smooth normal's.
    np.testing.assert_allclose(filled.mean(axis=0), GREY, rtol=1e-3)
    assert not frame.a[frame.alpha == 0.0].any()


def test_it_is_as_bright_as_the_diffuse_part_of_principled(shoot: RenderSource, light_of) -> None:
    light = light_of("white")
    principled = PrincipledSource("grey", {"Base Color": GREY, "Roughness": 1.0, "Specular IOR Level": 0.0})
    # Four halves of each, which are independent.
    ours, theirs = (
        [half.mean() for seed in range(2) for half in halves(shoot("suzanne", source, light, samples=32, seed=seed))]
        for source in (node_sources.diffuse(GREY), principled)
    )
    error = np.hypot(*(np.std(values, ddof=1) / 2.0 for values in (ours, theirs)))
    # Blender keeps its own normals in 16 bits, and shades facets at the edge of a shadow smoothly: up to 0.5 %.
    assert abs(np.mean(ours) - np.mean(theirs)) < 4.0 * error + 5e-3 * np.mean(theirs)


@pytest.fixture(scope="module")
def probed(blender: BlenderProcess, light_of) -> dict[str, Any]:
    facts: dict[str, Any] = blender.call("probes.build_nodes", light_of("city"))
    return facts


@pytest.mark.both_pythons
def test_a_turned_scene_is_a_turned_world(probed: dict[str, Any]) -> None:
    a, b = (probed[name].astype(np.float64).mean(axis=-1) for name in ("turned", "world_turned"))
    error = np.sqrt((a.var(axis=0, ddof=1) + b.var(axis=0, ddof=1)) / len(a))
    seen = error > 0.0
    t = (a.mean(axis=0) - b.mean(axis=0))[seen] / error[seen]
    # No bias, within four sigma of the mean of Student's t with 6 degrees of freedom.
    assert abs(t.mean()) < 4.0 * np.sqrt(6.0 / 4.0 / seen.sum())
    assert np.mean(np.abs(t) > 5.96) < 0.001 + 4.0 * np.sqrt(0.001 / seen.sum())  # 0.1 % of it are beyond 5.96


@pytest.mark.both_pythons
def test_nodes_become_blenders(probed: dict[str, Any]) -> None:
    facts = probed["facts"]
    assert facts["groups"] == 1, "equal groups are one"
    assert facts["colors"] == [[0.1, 0.2, 0.3, 1.0], [0.5, 0.5, 0.5, 1.0]]
    assert (facts["default"], facts["help"]) == ([0.8, 0.8, 0.8, 1.0], "The colour.")
    assert (facts["bump"], facts["emission"]) == (False, "NONE")
    assert facts["images"] == [["Non-Color", "CHANNEL_PACKED"]]


def test_behind_portals_is_light_and_behind_the_asset_is_none(shoot: RenderSource, light_of) -> None:
    light = light_of("white")
    frame = shoot("sphere", node_sources.portal(GREY), light, bounces=1)
    covered = shoot("sphere", node_sources.diffuse(GREY), light)
    np.testing.assert_allclose(frame.alpha, covered.alpha, atol=1e-6)
    assert not frame.a[frame.alpha == 0.0].any()
    # A ray passes the sphere twice; at its edge both places may be one.
    np.testing.assert_allclose(mean(frame)[20:28, 20:28], np.broadcast_to(np.square(GREY), (8, 8, 3)), rtol=1e-5)


def test_without_bounces_a_portal_ends_at_the_next_surface(shoot: RenderSource, light_of) -> None:
    frame = shoot("sphere", node_sources.portal(GREY), light_of("white"), bounces=0)
    again = shoot("plane", node_sources.portal(GREY), light_of("white"), bounces=0)
    assert again.a[again.alpha == 1.0].min() > 0.29
    assert frame.alpha.max() == 1.0


@pytest.mark.parametrize("kind", ["portal", pytest.param("diffuse", marks=pytest.mark.proof)])
def test_the_same_frame_again_is_the_same(kind: str, shoot: RenderSource, light_of) -> None:
    source, light = getattr(node_sources, kind)(GREY), light_of("city")
    options = {"samples": 4, "bounces": 1 if kind == "portal" else 0}
    first = shoot("sphere", source, light, **options)
    shoot("sphere", source, light, **options, pose=Pose(200.0, 10.0))
    again = shoot("sphere", source, light, **options)
    np.testing.assert_allclose(again.a, first.a, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(again.alpha, first.alpha)


def test_halves_are_independent_and_their_estimate_is_honest(shoot: RenderSource, light_of) -> None:
    source, light = node_sources.diffuse(GREY), light_of("city")
    frames = [shoot("sphere", source, light, samples=16, seed=seed) for seed in range(8)]
    truth, inside = np.mean([mean(frame) for frame in frames], axis=0), frames[0].alpha == 1.0
    # From a mean that they are part of, eight frames differ by 7/8 of their squared error.
    ratios = [frame.relmse / (relmse(mean(frame), truth, frame.alpha) * 8.0 / 7.0) for frame in frames]
    assert 0.5 < min(ratios) <= max(ratios) < 2.0, ratios
    around = [[(half - truth)[inside].mean(axis=-1) for half in halves(frame)] for frame in frames]
    alike = [np.corrcoef(a, b)[0, 1] for a, b in around]
    # The mean of correlations of some 900 pixels each, within four sigma of that of 2 of 16 about their common mean.
    assert abs(np.mean(alike) + 1.0 / 15.0) < 4.0 / np.sqrt(8 * 800), alike


def test_a_target_error_is_reached(shoot: RenderSource, light_of) -> None:
    frame = shoot("sphere", node_sources.diffuse(GREY), light_of("city"), samples=4096, error=2e-3)
    assert frame.relmse <= 2e-3
    assert 16 < frame.samples < 4096


def test_nodes_that_cycles_cannot_hold_are_reported_before_a_frame(shoot: RenderSource, light_of) -> None:
    light = light_of("white")
    message = r"look 'crowded': .* than Cycles' node machine has room for; .* backend = \"exact\""
    with pytest.raises(RenderError, match=message):
        shoot("sphere", node_sources.crowded(100), light)
    assert shoot("sphere", node_sources.crowded(60), light).alpha.max() == 1.0


def with_node(node: ShaderNode) -> NodeSource:
    source = node_sources.diffuse(GREY)
    material = source.trees[-1]
    return replace(source, trees=(*source.trees[:-1], replace(material, nodes=(*material.nodes, node))))


@pytest.mark.parametrize(
    ("node", "message"),
    [
        (ShaderNode("Odd", "Mathh"), "no node of kind 'Mathh'"),
        (ShaderNode("Odd", "Math", {"mode": "ADD"}), "property 'mode' cannot be 'ADD'"),
        (ShaderNode("Odd", "Math", {"operation": "PLUS"}), "property 'operation' cannot be 'PLUS'"),
        (ShaderNode("Odd", "Math", inputs={"Vector": 1.0}), "no socket 'Vector' among the inputs"),
        # It is there, but not of this operation.
        (ShaderNode("Odd", "Math", {"operation": "ADD"}, {"Value_002": 1.0}), "no socket 'Value_002' among the inputs"),
        (ShaderNode("Odd", "Math", inputs={"Value": "one"}), "socket 'Value' does not take 'one'"),
        (ShaderNode("Odd", "Math", inputs={"Value": NodeLink("Gone", "Value")}), "a missing node 'Gone'"),
        (
            ShaderNode("Odd", "Math", inputs={"Value": NodeLink("Surface", "baseColor")}),
            "no socket 'baseColor' among the ",
        ),
        (ShaderNode("Odd", "Group", group="Lookdev Gone"), "a group 'Lookdev Gone'"),
        (ShaderNode("Odd", "TexImage", image=Content("9", ".exr")), "lacks the file 9.exr"),
    ],
)
def test_what_blender_does_not_have_is_reported(node: ShaderNode, message: str, shoot: RenderSource, light_of) -> None:
    with pytest.raises(RenderError) as caught:
        shoot("sphere", with_node(node), light_of("white"))
    assert message in str(caught.value)
    assert "look 'diffuse', nodes 'diffuse', " in str(caught.value)
    assert "'Odd'" in str(caught.value)


def test_a_missing_device_is_reported_with_those_that_exist(shoot: RenderSource, light_of) -> None:
    device = "metal" if sys.platform != "darwin" else "cuda"
    with pytest.raises(RenderError, match=rf"no device of the kind '{device}' .* it finds: .*cpu"):
        shoot("sphere", node_sources.diffuse(GREY), light_of("white"), device=device)


def test_trees_of_a_material_may_have_no_groups(shoot: RenderSource, light_of) -> None:
    glow = ShaderNode("Surface", "Emission", inputs={"Color": GREY, "Strength": 2.0})
    output = ShaderNode("Output", "OutputMaterial", inputs={"Surface": NodeLink("Surface", "Emission")})
    source = NodeSource("glow", (NodeTree("glow", (glow, output)),), (), "glow", False)
    frame = shoot("sphere", source, light_of("white"), samples=2)
    np.testing.assert_allclose(mean(frame)[24, 24], 2.0 * np.array(GREY), rtol=1e-6)


SHEEN = (Layer("sheen", "disney", {"baseColor": (0.0, 0.0, 0.0), "sheen": 1.0, "specular": 0.0}),)
MATERIALS = Path(__file__).parents[2] / "materials"


def mean_color(frame: WorkerFrame) -> Any:
    return mean(frame)[frame.alpha > 0.5].mean(axis=0)


@pytest.mark.parametrize(
    "name", quick_among([(name,) for name in ("coated", "lacquered", "brushed", "sheen")], [("coated",)])
)
def test_white_light_is_reflected_as_by_the_exact_lobes(name: str, render: RenderScene, light_of) -> None:
    layers, options = SHEEN if name == "sheen" else LOOKS[name], {"samples": 64, "size": 32, "bounces": 1}
    exact, nodes = (
        mean_color(render("sphere", layers, light_of("white"), backend=backend, **options))
        for backend in ("exact", "nodes")
    )
    # The albedo over all views: documented to 1 % for each view. The noise of some 600 pixels is a tenth of that.
    np.testing.assert_allclose(nodes, exact, rtol=0.01)


def test_an_example_of_many_nodes_fits_into_cycles(render: RenderScene, light_of) -> None:
    layers = read_look(MATERIALS / "leaf.usda", None, {}).layers
    frame = render("sphere", layers, light_of("white"), backend="nodes", samples=4, size=16, bounces=1)
    assert mean_color(frame).min() > 0.01
