"""The viewport: a scene drawn in a browser by WebGL 2, its looks and lights as generated GLSL.

`view_scene` makes of a `lookdev.scene.Scene` what the page needs: plain data, and buffers named by their content. The
modules in ``static/`` draw it. Light is direct with cast shadow, and exactly that; `SceneView.left_out` names the rest.
"""

from lookdev.studio.viewport.view import SceneView, light_rows, sliders, view_scene

__all__ = ["SceneView", "light_rows", "sliders", "view_scene"]
