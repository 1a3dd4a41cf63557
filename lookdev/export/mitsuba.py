"""Exports a job as XML scenes for Mitsuba 3, for `lookdev export mitsuba`.

Looks are plug-ins of `lookdev.mitsuba`; lights, camera and meshes are Mitsuba's own. Coordinates in a scene are
relative to the asset's centre.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from lookdev.arrays import Floats
from lookdev.asset import Asset, Mesh
from lookdev.asset.triangles import triangulate
from lookdev.cache import atomic_path, output_errors, write_file
from lookdev.codegen.source import ProgramSource
from lookdev.errors import EnvironmentMapError, LookdevError
from lookdev.export import ExportResult
from lookdev.job.parts import JobLook
from lookdev.light import Light, light_label
from lookdev.light.dome.environment import read_exr, write_exr
from lookdev.light.emission import Emission
from lookdev.light.lamps import is_plain
from lookdev.mtlx import is_document
from lookdev.plan import Setup
from lookdev.plan.prepare import read_setups
from lookdev.scene import Camera, Pose

Matrix = Floats

# The matrix from Mitsuba's axes, with y up, to lookdev's axes, with z up. It also rotates Mitsuba's environment maps so
# that their columns have the directions that they have in lookdev.
_Y_UP_TO_Z_UP = np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
# Mitsuba's rectangles and disks emit along +z, lookdev's along -z.
_FLIP_Z = np.diag([1.0, -1.0, -1.0, 1.0])
# Fields of `Emission` that an exported light can set; all other fields must have their defaults.
_EXPORTED_FIELDS = {"color", "group", "path", "turns"}
# The properties of a vertex in a PLY file: position, normal and UV.
_VERTEX = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]


def export_mitsuba(job: Path, out: Path) -> ExportResult:
    """Write ``<look>.<light>.xml`` for each look under each light of a job, with its meshes and maps, into a folder.

    The asset and the light have the pose of the first frame of the first turntable. The scenes refer to the files of
    the looks. An existing file is replaced only by a complete one.

    Raises
    ------
    LookdevError
        The job is wrong, or the export does not support a look, a light or the camera, which the message names.
    OutputError
        A file cannot be written.
    """
    prepared = read_setups(job, backend="mitsuba")
    looks = {look.name: look for look in prepared.job.look}
    scenes = []
    with output_errors(out, name_file=True):
        out.mkdir(parents=True, exist_ok=True)
        for setup in prepared.setups:
            pose = setup.poses(prepared.job.turntable[0], prepared.job.camera.azimuth)[0]
            root = _build_scene(setup, looks[setup.look], pose, out)
            ElementTree.indent(root)
            file = out / f"{setup.look}.{setup.ibl}.xml"
            with atomic_path(file) as path:
                ElementTree.ElementTree(root).write(path, encoding="utf-8")
            scenes.append(file)
    text = (
        f"{out}: {', '.join(scene.name for scene in scenes)}; to render one: import mitsuba as mi; "
        f"mi.set_variant('llvm_ad_rgb'); import lookdev.mitsuba; mi.render(mi.load_file({str(scenes[0])!r}))"
    )
    return ExportResult(tuple(scenes), text, prepared.notes)


def _build_scene(setup: Setup, look: JobLook, pose: Pose, out: Path) -> ElementTree.Element:
    """Return the XML of a look under a light, and write the scene's meshes and environment maps below `out`."""
    if look.material is None or look.assign or look.layer:
        raise LookdevError(f"look '{look.name}': is on parts of the asset; looks with one 'material' are exported")
    if is_document(str(look.material)):
        raise LookdevError(f"look '{look.name}': {look.material} is a MaterialX document; looks of USD are exported")
    for source in setup.task.shaders:
        assert isinstance(source, ProgramSource)
        source.check_plugin(f"look '{look.name}'")
    sampling, scene = setup.task.sampling, setup.scene
    root = ElementTree.Element("scene", version="3.0.0")
    # Mitsuba's depth is 1 for light that the camera sees directly, and 2 for light that is reflected once. Russian
    # roulette would begin at depth 1000.
    _add_plugin(root, "integrator", "path", max_depth=sampling.bounces + 2, rr_depth=1000, hide_emitters=True)
    values = {f"variant_{name}": variant for name, variant in look.variants.items()}
    values |= {"prim": look.prim} if look.prim is not None else {}
    _add_plugin(root, "bsdf", "lookdev_look", file=str(look.material), **values).set("id", "look")
    center = np.array(scene.asset.center)
    _add_sensor(root, setup, pose, center)
    for name in _write_meshes(scene.asset, center, out / "meshes"):
        shape = _add_plugin(root, "shape", "ply", filename=f"meshes/{name}")
        ElementTree.SubElement(shape, "ref", id="look")
    for number, light in enumerate(setup.task.lights, start=1):
        _add_emitter(root, light, light_label(light, number), setup, pose, out / "lights")
    return root


def _add_sensor(root: ElementTree.Element, setup: Setup, pose: Pose, center: Floats) -> None:
    """Add the camera, orbited to the pose, with its sampler and film."""
    camera = setup.scene.camera.orbit(-pose.element)
    if camera.lens is not None or any(camera.shift):
        raise LookdevError("camera: depth of field and lens shift are not exported; 'lookdev render' shows them")
    right, up, back = camera.frame
    to_world = np.eye(4)
    # In Mitsuba's camera space, z points to the scene and x to the left.
    to_world[:3] = np.stack([-right, up, -back, camera.position - center], axis=1)
    near, far = map(float, camera.clip)
    lens: dict[str, float | str] = {"fov": float(camera.fov), "fov_axis": "x", "near_clip": near, "far_clip": far}
    sensor = _add_plugin(root, "sensor", "perspective", **lens)
    _add_transform(sensor, to_world)
    _add_plugin(sensor, "sampler", "multijitter", sample_count=256)
    width, height = setup.task.resolution
    film = _add_plugin(sensor, "film", "hdrfilm", width=width, height=height, pixel_format="rgba")
    _add_plugin(film, "rfilter", "box")


def _add_emitter(root: ElementTree.Element, light: Light, name: str, setup: Setup, pose: Pose, folder: Path) -> None:
    """Add a light, rotated to the pose; raise EnvironmentMapError if the export does not support the light.

    `name` is the light's name in messages. `folder` is the folder of the environment maps.
    """
    # The asset stays in its place: the camera (`_add_sensor`) and the lights rotate by `-pose.element` instead.
    gain, center = 2.0**setup.exposure, np.array(setup.scene.asset.center)
    degrees = (pose.lighting if light.emission.turns else 0.0) - pose.element
    turn = _rotation_about_pivot(degrees, setup.scene.camera, center)
    if dome := light.world_dome:
        if not is_plain(light):
            raise _unsupported_light(name, "a dome with a colour, axes or controls of its own")
        file = folder / f"{light.digest[:16]}.exr"
        if not file.exists():
            with atomic_path(file) as path:
                write_exr(path, "RGB", read_exr(dome.radiance_file.path, "RGB"))
        emitter = _add_plugin(root, "emitter", "envmap", filename=f"lights/{file.name}", scale=float(gain))
        _add_transform(emitter, turn @ _Y_UP_TO_Z_UP)
        return
    exported = Emission(**{field: getattr(light.emission, field) for field in _EXPORTED_FIELDS})
    if light.emission != exported or light.shape_name == "picture":
        raise _unsupported_light(name, "a beam, shadow, falloff, link, multiplier or texture")
    if light.mitsuba_shape is None or light.position is None:
        raise _unsupported_light(name, f"the kind '{light.kind}'")
    # `size` maps Mitsuba's shape to the light's own space.
    kind, size = light.mitsuba_shape
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = np.array(light.axes).T, np.array(light.position) - center
    shape = _add_plugin(root, "shape", kind)
    _add_transform(shape, turn @ to_world @ size @ (_FLIP_Z if light.one_sided else np.eye(4)))
    emitter = _add_plugin(shape, "emitter", "area")
    ElementTree.SubElement(
        emitter, "rgb", name="radiance", value=_format_numbers(gain * np.array(light.emission.color))
    )


def _unsupported_light(name: str, feature: str) -> EnvironmentMapError:
    """Return the error for a light with a feature that is not exported."""
    return EnvironmentMapError(f"{name}: {feature} is not exported: backend 'mitsuba' of 'lookdev render' may show it")


def _rotation_about_pivot(degrees: float, camera: Camera, center: Floats) -> Matrix:
    """Return the rotation (4, 4) about the vertical axis that the camera orbits, for points relative to `center`."""
    angle = np.radians(degrees)
    turn, to_pivot = np.eye(4), np.eye(4)
    turn[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    to_pivot[:2, 3] = np.array(camera.pivot) - center[:2]
    return np.asarray(to_pivot @ turn @ np.linalg.inv(to_pivot))


def _write_meshes(asset: Asset, center: Floats, folder: Path) -> Iterator[str]:
    """Write the triangles of each instance as a file, in world space relative to `center`; yield the files' names."""
    for number, instance in enumerate(asset.instances):
        name = f"{asset.digest[:16]}.{number}.ply"
        if not (folder / name).exists():
            mesh = triangulate(asset.meshes[instance.mesh])
            write_file(folder / name, _encode_ply(mesh, instance.matrix, center))
        yield name


def _encode_ply(mesh: Mesh, matrix: Matrix, center: Floats) -> bytes:
    """Return a mesh of triangles as a binary PLY (Turk 1994) with a vertex for each corner.

    `matrix` (4, 4) places the mesh in world space; points are relative to `center`. The UVs are the default UV set, or
    else the first set.
    """
    corners = mesh.corner_points
    normals = mesh.normals @ np.linalg.inv(matrix[:3, :3])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    default_uvs = mesh.uvs.get(mesh.default_uv) if mesh.default_uv in mesh.uvs else next(iter(mesh.uvs.values()), None)
    uv = np.zeros((len(corners), 2)) if default_uvs is None else default_uvs
    points = mesh.points[corners] @ matrix[:3, :3].T + matrix[:3, 3] - center
    vertices = np.concatenate([points, normals, uv], axis=1).astype("<f4")
    faces = np.zeros(len(corners) // 3, [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    order = np.arange(len(corners)).reshape(-1, 3)
    # The triangles of a mirrored instance are reversed; otherwise it would be inside out.
    faces["corners"] = order[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else order
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name, _ in _VERTEX]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    return b"".join(["\n".join(head).encode(), vertices.tobytes(), faces.tobytes()])


def _add_plugin(
    parent: ElementTree.Element, tag: str, plugin: str, **values: bool | int | float | str
) -> ElementTree.Element:
    """Add an object of Mitsuba's plug-in `plugin` with the given parameters to the scene, and return its element.

    `tag` is the plug-in's type, such as "emitter".
    """
    element = ElementTree.SubElement(parent, tag, type=plugin)
    for name, value in values.items():
        kind = {bool: "boolean", int: "integer", float: "float", str: "string"}[type(value)]
        text = str(value).lower() if isinstance(value, bool) else str(value)
        ElementTree.SubElement(element, kind, name=name, value=text)
    return element


def _add_transform(parent: ElementTree.Element, matrix: Sequence[Sequence[float]] | Matrix) -> None:
    """Add the matrix (4, 4), for column vectors, that places an object in the scene."""
    element = ElementTree.SubElement(parent, "transform", name="to_world")
    ElementTree.SubElement(element, "matrix", value=_format_numbers(matrix))


def _format_numbers(values: Sequence[Sequence[float]] | Floats) -> str:
    """Return numbers, row by row, as text that reads back to the same numbers."""
    return " ".join(repr(float(value)) for value in np.ravel(values))
