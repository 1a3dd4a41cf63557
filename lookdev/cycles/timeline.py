"""Writes turntables to Blender's timeline, for `lookdev export blend`.

There is one keyframe per frame, with exactly the value that a render of the frame uses.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import bpy
import numpy as np
from bpy.types import Object

from lookdev.arrays import Floats
from lookdev.rendering.blend import BlendTurntable
from lookdev.scene import Pose

_PATHS = ("location", "rotation_euler")  # the animated properties of an object, three numbers each
_KEY_GAP = 1.0 / 64.0
"""The distance, in frames, from the reset of an angle to the next key (`_keys`).

This distance is exact in float32, and larger than the distance at which Blender merges keys."""


def animate(objects: Mapping[str, Object], turntables: Sequence[BlendTurntable], pose: Callable[[Pose], None]) -> None:
    """Animate objects over turntables, which follow each other from frame 1 on, by a single action of Blender.

    The keys of `objects` are their names in the action. `pose` sets the location and XYZ Euler angles of all objects
    for a pose.
    """
    action = bpy.data.actions.new("turntables")
    strip = action.layers.new("turntables").strips.new(type="KEYFRAME")
    tables = [_sample_transforms(list(objects.values()), turntable, pose) for turntable in turntables]
    for number, (name, item) in enumerate(objects.items()):
        slot = action.slots.new(id_type="OBJECT", name=name)
        _add_curves(strip.channelbag(slot, ensure=True), [table[number] for table in tables])
        data = item.animation_data_create()
        data.action, data.action_slot = action, slot


def share_animation(item: Object, other: Object) -> None:
    """Animate an object by the curves of another object."""
    data = item.animation_data_create()
    data.action, data.action_slot = other.animation_data.action, other.animation_data.action_slot


def mark_turntables(scene: bpy.types.Scene, turntables: Sequence[BlendTurntable]) -> None:
    """Set the frame range of a scene to the range of its turntables; add a marker at the start of each turntable."""
    frame = 1
    for turntable in turntables:
        scene.timeline_markers.new(turntable.name, frame=frame)
        frame += len(turntable.poses)
    scene.frame_start, scene.frame_end = 1, frame - 1
    scene.frame_set(1)


def _sample_transforms(objects: Sequence[Object], turntable: BlendTurntable, pose: Callable[[Pose], None]) -> Floats:
    """Return locations and XYZ Euler angles, three numbers each, of objects in a turntable: (objects, frames, 6)."""
    frames = []
    for turntable_pose in turntable.poses:
        pose(turntable_pose)
        frames.append([[*item.location, *item.rotation_euler] for item in objects])
    return np.array(frames).transpose(1, 0, 2)


def _add_curves(bag: bpy.types.ActionChannelbag, tables: Sequence[Floats]) -> None:
    """Add the curves of an object: one for each column that varies in the tables.

    There is a table (frames, 6) for each turntable, with the columns of `_sample_transforms`.
    """
    values = np.concatenate(tables)
    for column, (path, index) in enumerate((path, index) for path in _PATHS for index in range(3)):
        if np.ptp(values[:, column]) == 0.0:
            continue
        keys: list[tuple[float, float, str]] = []
        first = 1
        for table in tables:
            keys += _keys(first, table[:, column].tolist(), 2.0 * math.pi if path == "rotation_euler" else math.inf)
            first += len(table)
        points = bag.fcurves.new(path, index=index).keyframe_points
        points.add(len(keys))
        for point, (frame, value, interpolation) in zip(points, keys, strict=True):
            point.co = frame, value
            point.interpolation = interpolation


def _keys(first: int, values: Sequence[float], period: float) -> Iterator[tuple[float, float, str]]:
    """Yield the keys of a curve from frame `first` on, each as frame, value and interpolation.

    Values are exact at every frame, and linear in between. A periodic value may wrap between two frames. The curve then
    continues past the period, and is reset just before the second frame. Without the reset, an angle beyond a whole
    turn would be rounded differently from the angle in the rendered frame.
    """
    for frame, (value, following) in enumerate(itertools.pairwise(values), start=first):
        yield frame, value, "LINEAR"
        jump = following - value
        if abs(jump) > period / 2.0:
            yield frame + 1 - _KEY_GAP, following - math.copysign(period, jump), "CONSTANT"
    yield first + len(values) - 1, values[-1], "CONSTANT"
