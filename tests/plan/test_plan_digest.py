"""Digests: every input that affects pixels counts, in the part that bears its name; paths do not."""

from collections.abc import Callable
from dataclasses import fields, replace
from typing import Any

import pytest

from lookdev.cache import Content
from lookdev.codegen.source import NodeSource, PrincipledSource
from lookdev.plan.digest import frame_digest, part_digests, pose_digest
from lookdev.rendering import backends
from lookdev.rendering.task import SceneTask
from lookdev.scene import Camera, Lens, Pose, Sampling

POSE = Pose(30.0, 60.0)
CAMERA = {"fov": 40.0, "elevation": 11.0, "distance": 4.0, "target": (0.0, 0.0, 0.0), "azimuth": 1.0, "roll": 1.0}
CAMERA |= {"axis": (0.0, 0.0), "shift": (0.1, 0.0), "lens": Lens(0.01, 3.7)}
SAMPLING = {"samples": 128, "passes": ("depth",), "error": 1e-3, "brdf_samples": 3, "ibl_samples": 3}
SAMPLING |= {"bounces": 3, "seed": 1, "denoise": "measured"}
Change = Callable[[SceneTask], SceneTask]


def changed_parts(before: dict[str, str], after: dict[str, str]) -> set[str]:
    assert before.keys() == after.keys()
    changed = {part for part in before if before[part] != after[part]}
    assert (frame_digest(before) != frame_digest(after)) == bool(changed)
    return changed


def scene_with(name: str, value: Callable[[SceneTask], Any]) -> Change:
    return lambda scene: replace(scene, **{name: value(scene)})


def sampling(**values: Any) -> Change:
    return lambda scene: replace(scene, sampling=replace(scene.sampling, **values))


def camera(**values: Any) -> Change:
    return lambda scene: replace(scene, camera=replace(scene.camera, **values))


SCENE: dict[str, tuple[Callable[[SceneTask], Any], str]] = {
    "asset": (lambda scene: Content("b", ".npz"), "asset"),
    "shaders": (lambda scene: (replace(scene.shaders[0], digest="1"),), "look"),
    "slot_shaders": (lambda scene: (0, 0), "look"),
    "lights": (lambda scene: (replace(scene.lights[0], map_digest="1"),), "ibl"),
    "shader_lights": (lambda scene: ((0,),), "ibl"),
    "groups": (lambda scene: (1,), "ibl"),
    "resolution": (lambda scene: (48, 64), "render"),
    "device": (lambda scene: "cuda", "render"),
    "space": (lambda scene: "acescg", "render"),
}


@pytest.mark.parametrize(
    ("change", "part"),
    [
        *((scene_with(name, value), part) for name, (value, part) in SCENE.items()),
        *((camera(**{name: value}), "camera") for name, value in CAMERA.items()),
        *((sampling(**{name: value}), "render") for name, value in SAMPLING.items()),
    ],
)
def test_a_scene_change_changes_its_part_only(scene: SceneTask, change: Change, part: str) -> None:
    before = part_digests(scene, POSE, 0.0)
    assert changed_parts(before, part_digests(change(scene), POSE, 0.0)) == {part}


def test_no_field_is_left_out() -> None:
    """The others have a test below: sources of each backend, and what only passes show."""
    elsewhere = {"backend", "prims", "light_groups"}
    assert {*SCENE, "camera", "sampling"} | elsewhere == {field.name for field in fields(SceneTask)}
    assert CAMERA.keys() == {field.name for field in fields(Camera)}
    assert SAMPLING.keys() == {field.name for field in fields(Sampling)}


def test_pose_exposure_and_versions_count(scene: SceneTask, monkeypatch: pytest.MonkeyPatch) -> None:
    before = part_digests(scene, POSE, 0.0)
    assert changed_parts(before, part_digests(scene, Pose(60.0, 30.0), 0.0)) == {"pose"}
    assert changed_parts(before, part_digests(scene, POSE, 0.5)) == {"ibl"}
    monkeypatch.setattr(backends, "blender_version", lambda: "3.6.0")
    other_blender = part_digests(scene, POSE, 0.0)
    assert changed_parts(before, other_blender) == {"render"}
    monkeypatch.setattr(backends, "RENDER_VERSION", backends.RENDER_VERSION + 1)
    assert changed_parts(other_blender, part_digests(scene, POSE, 0.0)) == {"render"}


def test_a_version_of_nodes_counts_for_them_alone(
    scene: SceneTask, node_source: NodeSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenes = scene, replace(scene, backend="nodes", shaders=(node_source,))
    before = [part_digests(task, POSE, 0.0) for task in scenes]
    monkeypatch.setattr(backends, "NODES_VERSION", backends.NODES_VERSION + 1)
    after = [part_digests(task, POSE, 0.0) for task in scenes]
    assert [changed_parts(*pair) for pair in zip(before, after, strict=True)] == [set(), {"render"}]


def test_every_kind_of_source_counts(scene: SceneTask, node_source: NodeSource) -> None:
    principled = [PrincipledSource("p", {"Roughness": roughness}) for roughness in (0.5, 0.6)]
    sources = [scene.shaders[0], node_source, replace(node_source, digest="1"), *principled]
    names = ["exact", "nodes", "nodes", "principled", "principled"]
    scenes = [replace(scene, backend=name, shaders=(source,)) for name, source in zip(names, sources, strict=True)]
    parts = [part_digests(task, POSE, 0.0) for task in scenes]
    assert len({digests["look"] for digests in parts}) == 5
    assert [len({digests[part] for digests in parts}) for part in ("asset", "ibl", "camera", "pose")] == [1] * 4


def test_what_only_passes_show_counts_where_there_are_passes(scene: SceneTask) -> None:
    described = replace(scene, prims=("/ball",), light_groups=("key",))
    before = [part_digests(replace(scene, sampling=replace(scene.sampling, passes=p)), POSE, 0.0) for p in ((), ("z",))]
    after = [
        part_digests(replace(described, sampling=replace(scene.sampling, passes=p)), POSE, 0.0) for p in ((), ("z",))
    ]
    assert [changed_parts(*pair) for pair in zip(before, after, strict=True)] == [set(), {"render"}]
    grouped = replace(described, prims=scene.prims, sampling=replace(scene.sampling, passes=("z",)))
    assert changed_parts(before[1], part_digests(grouped, POSE, 0.0)) == {"render"}


def test_a_digest_is_of_values_in_any_order_and_of_numbers_alone() -> None:
    assert frame_digest({"pose": "1", "look": "2"}) == frame_digest({"look": "2", "pose": "1"})
    with pytest.raises(ValueError, match="not JSON compliant"):
        pose_digest(Pose(float("nan"), 0.0))
