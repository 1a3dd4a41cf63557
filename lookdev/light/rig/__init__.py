"""Rigs: the lights of a USD stage.

Module `read` composes the rig, with these modules: `find` finds the prims that are lights, each kind of light reads the
shape of its own prims (`lookdev.light.usd`), `emission` reads the emission, which all kinds share, and `attributes`
reads and checks single values. All faults of a rig are reported together, each with its prim.

A rig whose root has ``custom bool lookdev:fit = true`` fits an asset of any size: its unit is the radius of the asset's
bounding sphere, and its origin the centre of that sphere. The rig's lights are read with a unit of 1 m;
`lookdev.light.Light.rescale` converts them.
"""

from lookdev.light.rig.read import LightRig, RigLight, holds_only_lights, load_rig, read_rig

__all__ = ["LightRig", "RigLight", "holds_only_lights", "load_rig", "read_rig"]
