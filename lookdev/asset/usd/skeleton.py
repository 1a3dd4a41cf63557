"""Reads skeletons of UsdSkel at a given time: the transforms of their joints, and the weights of blend shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdSkel

from lookdev.arrays import Floats
from lookdev.asset.usd.attributes import read_array, read_texts
from lookdev.errors import AssetError
from lookdev.stage import prim_and_ancestors, relationship_targets

_ANIMATION = "skel:animationSource"
_COMPONENTS = {"translations": (3,), "rotations": (4,), "scales": (3,)}  # of an animation, with the shape of one value


@dataclass(frozen=True, eq=False)
class SkeletonPose:
    """A skeleton's pose: the names of its j joints, and the transforms (j, 4, 4) from the bind pose to the pose.

    The transforms are matrices for row vectors in the space of the skeleton.
    """

    names: tuple[str, ...]
    transforms: Floats


class Skeletons:
    """Reads skeletons at a given time.

    `notes` collects lines for the user about missing or ignored parts of a file, and about their effect by USD's rules.
    """

    def __init__(self, time: Usd.TimeCode) -> None:
        self.notes: list[str] = []
        self._time = time
        self._cache = UsdSkel.Cache()
        self._poses: dict[Sdf.Path, SkeletonPose | None] = {}
        self._animations: dict[Sdf.Path, Usd.Prim | None] = {}

    def pose(self, skeleton: Usd.Prim) -> SkeletonPose | None:
        """Return the pose of a skeleton; None if it has neither an animation of its joints nor a rest pose.

        Raises
        ------
        AssetError
            Joints, transforms and animation contradict each other, or a bind transform has no inverse.
        """
        path = skeleton.GetPath()
        if path not in self._poses:
            self._poses[path] = self._compute_pose(skeleton)
        return self._poses[path]

    def animation(self, skeleton: Usd.Prim) -> Usd.Prim | None:
        """Return the SkelAnimation that is bound to a skeleton, or else to its nearest bound ancestor, or None."""
        path = skeleton.GetPath()
        if path not in self._animations:
            self._animations[path] = self._find_animation(skeleton)
        return self._animations[path]

    def weights(self, skeleton: Usd.Prim) -> dict[str, float]:
        """Return the weights that a skeleton's animation gives to blend shapes, by the names of the blend shapes.

        Raises
        ------
        AssetError
            The animation does not have one finite weight for each name.
        """
        animation = self.animation(skeleton)
        if animation is None:
            return {}
        names = read_texts(animation, "blendShapes")
        weights = read_array(animation, "blendShapeWeights", self._time, np.float64)
        if len(weights) and len(weights) != len(names):
            raise AssetError(
                f"{animation.GetPath()}: has {len(weights)} blendShapeWeights, but {len(names)} blendShapes; "
                "they must agree"
            )
        return dict(zip(names, weights.tolist(), strict=False))

    def _find_animation(self, skeleton: Usd.Prim) -> Usd.Prim | None:
        """Return the result of `animation`; append a note if the nearest binding is not to a SkelAnimation."""
        for prim in prim_and_ancestors(skeleton):
            targets = relationship_targets(prim.GetRelationship(_ANIMATION)) if prim.HasAPI(UsdSkel.BindingAPI) else []
            if targets:
                animation = prim.GetStage().GetPrimAtPath(targets[0])
                if animation and animation.IsA(UsdSkel.Animation):
                    return animation
                self.notes.append(f"{prim.GetPath()}: {_ANIMATION} {targets[0]} is not a SkelAnimation: the rest pose")
                return None
        return None

    def _compute_pose(self, skeleton: Usd.Prim) -> SkeletonPose | None:
        """Return the result of `pose`; append a note if the skeleton does not deform anything."""
        path = skeleton.GetPath()
        names = read_texts(skeleton, "joints")
        if not names or len(set(names)) != len(names) or not all(Sdf.Path.IsValidPathString(name) for name in names):
            raise AssetError(f"{path}: joints must be paths such as 'hip/knee', at least one, each once")
        is_valid, reason = UsdSkel.Topology(list(names)).Validate()
        if not is_valid:
            raise AssetError(f"{path}: joints are not in order: {reason}")
        bind = _joint_matrices(skeleton, "bindTransforms", len(names))
        if bind is None or (np.linalg.det(bind) == 0.0).any():
            raise AssetError(f"{path}: bindTransforms must be matrices with an inverse, one for each joint")
        has_rest_pose = _joint_matrices(skeleton, "restTransforms", len(names)) is not None
        animated = self._animated_joints(skeleton, set(names))
        if not animated and not has_rest_pose:
            self.notes.append(f"{path}: has neither an animation nor restTransforms: what it moves stays as it is")
            return None
        if not has_rest_pose and animated != set(names):
            missing = next(name for name in names if name not in animated)
            raise AssetError(f"{path}: joint {missing} is not animated, and there are no restTransforms")
        skinning_transforms = self._cache.GetSkelQuery(UsdSkel.Skeleton(skeleton)).ComputeSkinningTransforms(self._time)
        transforms = np.array(skinning_transforms, np.float64)
        if transforms.shape != (len(names), 4, 4) or not np.isfinite(transforms).all():
            raise AssetError(f"{path}: USD cannot compute finite transforms of its {len(names)} joints")
        return SkeletonPose(names, transforms)

    def _animated_joints(self, skeleton: Usd.Prim, names: set[str]) -> set[str]:
        """Return the joints in `names` that the animation moves; append a note if USD ignores the animation."""
        animation = self.animation(skeleton)
        if animation is None:
            return set()
        path, joints = animation.GetPath(), read_texts(animation, "joints")
        counts = {
            name: len(read_array(animation, name, self._time, np.float64, shape)) for name, shape in _COMPONENTS.items()
        }
        if not any(counts.values()):
            return set()
        if missing := [name for name, count in counts.items() if count == 0]:
            self.notes.append(f"{path}: has no {' and '.join(missing)}, without which USD ignores it: the rest pose")
            return set()
        for name, count in counts.items():
            if count != len(joints):
                raise AssetError(f"{path}: has {count} {name}, but {len(joints)} joints; they must agree")
        if joints and not names & set(joints):
            self.notes.append(f"{path}: animates no joint of {skeleton.GetPath()}: the rest pose")
        return names & set(joints)


def _joint_matrices(prim: Usd.Prim, name: str, count: int) -> Floats | None:
    """Return an attribute's matrices (count, 4, 4), one for each joint, or None if the attribute has no value."""
    matrices = read_array(prim, name, Usd.TimeCode.Default(), np.float64, (4, 4))
    if len(matrices) == 0:
        return None
    if len(matrices) != count:
        raise AssetError(f"{prim.GetPath()}: has {len(matrices)} {name}, but {count} joints; they must agree")
    return matrices
