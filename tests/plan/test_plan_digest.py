"""Digests: every input that affects pixels counts, in the part that bears its name; paths do not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from lookdev.codegen import NodeSource, PrincipledSource
from lookdev.plan import digest as digest_module
from lookdev.plan.digest import frame_digest, part_digests
from lookdev.render.task import SceneTask
from lookdev.scene.camera import Pose

POSE = Pose(30.0, 60.0)
Change = Callable[[SceneTask], SceneTask]


def changed_parts(before: dict[str, str], after: dict[str, str]) -> set[str]:
    assert before.keys() == after.keys()
    changed = {part for part in before if before[part] != after[part]}
    assert (frame_digest(before) != frame_digest(after)) == bool(changed)
    return changed


def sampling(**values: Any) -> Change:
    return lambda scene: replace(scene, sampling=replace(scene.sampling, **values))


def camera(**values: Any) -> Change:
    return lambda scene: replace(scene, camera=replace(scene.camera, **values))


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda scene: replace(scene, asset_file=Path("/cache/assets/b.npz")), "asset"),
        (lambda scene: replace(scene, shaders=(replace(scene.shaders[0], digest="1"),)), "look"),
        (lambda scene: replace(scene, shaders=scene.shaders * 2), "look"),
        (lambda scene: replace(scene, light=replace(scene.light, digest="1")), "ibl"),
        (camera(fov=40.0), "camera"),
        (camera(elevation=11.0), "camera"),
        (camera(distance=4.0), "camera"),
        (camera(target=(0.0, 0.0, 0.0)), "camera"),
        (lambda scene: replace(scene, resolution=(48, 64)), "render"),
        (lambda scene: replace(scene, device="cuda"), "render"),
        (sampling(samples=128), "render"),
        (sampling(error=1e-3), "render"),
        (sampling(brdf_samples=3), "render"),
        (sampling(ibl_samples=3), "render"),
        (sampling(bounces=3), "render"),
        (sampling(seed=1), "render"),
    ],
)
def test_a_scene_change_changes_its_part_only(scene: SceneTask, change: Change, part: str) -> None:
    before = part_digests(scene, POSE, 0.0)
    assert changed_parts(before, part_digests(change(scene), POSE, 0.0)) == {part}


def test_pose_and_exposure_count(scene: SceneTask) -> None:
    before = part_digests(scene, POSE, 0.0)
    assert changed_parts(before, part_digests(scene, Pose(60.0, 30.0), 0.0)) == {"pose"}
    assert changed_parts(before, part_digests(scene, POSE, 0.5)) == {"ibl"}


def test_versions_count(scene: SceneTask, monkeypatch: pytest.MonkeyPatch) -> None:
    before = part_digests(scene, POSE, 0.0)
    monkeypatch.setattr(digest_module, "blender_version", lambda: "3.6.0")
    other_blender = part_digests(scene, POSE, 0.0)
    assert changed_parts(before, other_blender) == {"render"}
    monkeypatch.setattr(digest_module, "RENDER_VERSION", digest_module.RENDER_VERSION + 1)
    assert changed_parts(other_blender, part_digests(scene, POSE, 0.0)) == {"render"}


def test_every_kind_of_source_counts(scene: SceneTask, node_source: NodeSource) -> None:
    before = part_digests(scene, POSE, 0.0)
    nodes = part_digests(replace(scene, shaders=(node_source,)), POSE, 0.0)
    other = part_digests(replace(scene, shaders=(replace(node_source, digest="1"),)), POSE, 0.0)
    principled = [
        part_digests(replace(scene, shaders=(PrincipledSource("p", {"Roughness": roughness}),)), POSE, 0.0)
        for roughness in (0.5, 0.6)
    ]
    for parts in (nodes, other, *principled):
        assert changed_parts(before, parts) == {"look"}
    assert len({parts["look"] for parts in (nodes, other, *principled)}) == 4


def test_a_scene_has_one_kind_of_source(scene: SceneTask, node_source: NodeSource) -> None:
    portal = replace(node_source, exact=True)
    assert replace(scene, shaders=(portal, portal)).shaders == (portal, portal)
    for sources, found in (
        ((), "none"),
        ((scene.shaders[0], node_source), "NodeSource, ShaderSource"),
        ((portal, node_source), "NodeSource, NodeSource that is exact"),
    ):
        with pytest.raises(ValueError, match=f"one kind of source in all its slots, found: {found}$"):
            replace(scene, shaders=sources)


def test_paths_do_not_count(scene: SceneTask) -> None:
    moved = replace(
        scene,
        asset_file=Path("/elsewhere/a55e7.npz"),
        light=replace(scene.light, radiance_file=Path("/elsewhere/r.exr"), slots_file=Path("/elsewhere/s.exr")),
        shaders=(replace(scene.shaders[0], textures=()),),
    )
    assert part_digests(scene, POSE, 0.0) == part_digests(moved, POSE, 0.0)
