"""What a backend makes of a look, for a light, a picture and a way of sampling."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from lookdev.codegen import NodeSource, ShaderSource
from lookdev.codegen.nodes.exact import generate_nodes_exact
from lookdev.codegen.nodes.look import generate_nodes
from lookdev.codegen.osl.surface import generate_surface
from lookdev.job.schema import Backend
from lookdev.light import Light, world_image
from lookdev.material import Bump, Look, Texture
from lookdev.material.textures import image_file
from lookdev.scene.sampling import Sampling


def surface_shader(
    look: Look,
    light: Light,
    resolution: tuple[int, int],
    sampling: Sampling,
    resolve: Callable[[Texture | Bump], Path] = image_file,
    *,
    shadows: bool = True,
) -> ShaderSource:
    """Generate the light integral shader of a look, as `generate_surface` does."""
    return generate_surface(
        look,
        resolve,
        brdf_samples=sampling.brdf_samples,
        ibl_samples=sampling.ibl_samples,
        bounces=sampling.bounces,
        light=light,
        shadows=shadows,
        resolution=resolution,
    )


def look_source(
    look: Look,
    backend: Backend,
    light: Light,
    resolution: tuple[int, int],
    sampling: Sampling,
    resolve: Callable[[Texture | Bump], Path] = image_file,
    *,
    shadows: bool = True,
) -> ShaderSource | NodeSource:
    """Generate what a slot that wears a look is given under a backend; without `shadows` no asset is in light's way.

    Raises
    ------
    CodegenError
        The backend cannot show such a look.
    EnvironmentMapError
        The backend cannot show such a light.
    """
    if backend != "exact":
        world_image(light)
    match backend:
        case "exact":
            return surface_shader(look, light, resolution, sampling, resolve, shadows=shadows)
        case "nodes":
            return generate_nodes(look, resolve)
        case "nodes-exact":
            return generate_nodes_exact(look, resolve, bounces=sampling.bounces)
