"""Reference props beside the asset: a chrome ball, a grey ball and a colour chart, in a separate scene.

`colorchecker` has the chart's published colours, `props` the positions of the props in the frame, and their scene.
"""

from lookdev.scene.charts.colorchecker import GREY, PATCHES, patch_colors
from lookdev.scene.charts.props import FOLDER, PLACES, STRIP, Box, Strip, asset_of_props, props_camera, props_scene

__all__ = [
    "FOLDER",
    "GREY",
    "PATCHES",
    "PLACES",
    "STRIP",
    "Box",
    "Strip",
    "asset_of_props",
    "patch_colors",
    "props_camera",
    "props_scene",
]
