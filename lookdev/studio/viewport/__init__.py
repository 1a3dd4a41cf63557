"""The viewport: it draws a scene in a browser by WebGL 2, with looks and lights as generated GLSL.

`view_scene` converts a `lookdev.scene.Scene` for the page: to data for JSON, and to buffers of bytes, each named by a
digest of its content. The scripts in ``static/`` draw the scene. The picture has direct light with cast shadows;
`SceneView.left_out` lists the effects that it lacks.
"""

from lookdev.studio.viewport.view import SceneView, light_rows, slider_constants, view_scene

__all__ = ["SceneView", "light_rows", "slider_constants", "view_scene"]
