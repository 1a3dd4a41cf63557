"""Rigs: the lights of a USD stage.

`find` says which prims are lights, each kind of light reads its own (`lookdev.light.usd`), `emission` reads what all
share, `attributes` is
the door through which values come. All faults of a rig are reported together, each at its prim.

A rig whose root carries ``custom bool lookdev:fit = true`` is made for an asset of any size: its unit is the radius of
the asset's bounding sphere, about whose centre it stands. Its lights are read with a unit of 1 m, for
`lookdev.light.Light.scaled`.
"""

from lookdev.light.rig.read import Rig, RigLight, holds_only_lights, load_rig, read_rig

__all__ = ["Rig", "RigLight", "holds_only_lights", "load_rig", "read_rig"]
