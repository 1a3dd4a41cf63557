"""Denoises pictures by Open Image Denoise, whose library is called directly; it comes with Blender's wheel, bpy.

- Afra, A. T. Intel Open Image Denoise, https://www.openimagedenoise.org (its C interface).
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import weakref
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from lookdev.arrays import Floats32
from lookdev.errors import RenderError
from lookdev.rendering.threads import usable_cores

_CPU, _FLOAT3, _BALANCED = 1, 3, 5  # OIDN_DEVICE_TYPE_CPU, OIDN_FORMAT_FLOAT3, OIDN_QUALITY_BALANCED
_POINTER, _SIZE, _TEXT = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_char_p
# The functions of the library that are called here, by name: the type of the result, and the types of the arguments.
_FUNCTIONS: dict[str, tuple[object, list[object]]] = {
    "oidnNewDevice": (_POINTER, [ctypes.c_int]),
    "oidnSetDeviceInt": (None, [_POINTER, _TEXT, ctypes.c_int]),
    "oidnSetDeviceBool": (None, [_POINTER, _TEXT, ctypes.c_bool]),
    "oidnCommitDevice": (None, [_POINTER]),
    "oidnGetDeviceError": (ctypes.c_int, [_POINTER, ctypes.POINTER(_TEXT)]),
    "oidnNewFilter": (_POINTER, [_POINTER, _TEXT]),
    "oidnSetSharedFilterImage": (None, [_POINTER, _TEXT, _POINTER, ctypes.c_int, *[_SIZE] * 5]),
    "oidnSetFilterBool": (None, [_POINTER, _TEXT, ctypes.c_bool]),
    "oidnSetFilterInt": (None, [_POINTER, _TEXT, ctypes.c_int]),
    "oidnCommitFilter": (None, [_POINTER]),
    "oidnExecuteFilter": (None, [_POINTER]),
    "oidnReleaseFilter": (None, [_POINTER]),
}


@cache
def _load_library() -> tuple[ctypes.CDLL, int]:
    """Return the library and its CPU device; raises RenderError where the library cannot be loaded."""
    spec = importlib.util.find_spec("bpy")  # finds the package without importing Blender
    folders = [Path(folder, "lib") for folder in (spec.submodule_search_locations or ()) if spec] if spec else []
    files = [file for folder in folders for file in sorted(folder.glob("libOpenImageDenoise.so*"))]
    if not files:
        raise RenderError(
            "Open Image Denoise is not among the libraries of Blender's wheel: bpy is not installed whole"
        )
    try:
        library = ctypes.CDLL(str(files[0]))
    except OSError as error:
        raise RenderError(f"{files[0]}: cannot be loaded: {error}") from error
    for name, (result, arguments) in _FUNCTIONS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    device = library.oidnNewDevice(_CPU)
    if usable_cores() < (os.cpu_count() or 1):
        library.oidnSetDeviceInt(device, b"numThreads", usable_cores())
        # By default, the library pins its threads to the first cores of the machine, even if this process may not use
        # them.
        library.oidnSetDeviceBool(device, b"setAffinity", False)
    library.oidnCommitDevice(device)
    _raise_error(library, device)
    return library, device


def make_denoiser(albedo: Floats32, normal: Floats32, *, quick: bool = False) -> Callable[[Floats32], Floats32]:
    """Return a function that denoises pictures of radiance (H, W, 3), linear and not negative.

    albedo, normal : (H, W, 3), of the same view, without noise. Albedos are in [0, 1]. Normals are unit vectors, or 0.
    quick : whether to use the library's quality "balanced" instead of "high": 0.4 of the time, about 6 % more error
    (relMSE).

    Raises
    ------
    RenderError
        The library cannot be loaded, or reports an error.
    """
    library, device = _load_library()
    height, width = albedo.shape[:2]
    noisy, smooth = (np.zeros((height, width, 3), np.float32) for _ in range(2))
    images = {
        b"color": noisy,
        b"output": smooth,
        b"albedo": np.ascontiguousarray(albedo, np.float32),
        b"normal": np.ascontiguousarray(normal, np.float32),
    }
    filter_ = library.oidnNewFilter(device, b"RT")
    for name, image in images.items():
        library.oidnSetSharedFilterImage(filter_, name, image.ctypes.data, _FLOAT3, width, height, 0, 0, 0)
    library.oidnSetFilterBool(filter_, b"hdr", True)
    library.oidnSetFilterBool(filter_, b"cleanAux", True)
    if quick:
        library.oidnSetFilterInt(filter_, b"quality", _BALANCED)
    library.oidnCommitFilter(filter_)
    _raise_error(library, device)

    def denoise(picture: Floats32) -> Floats32:
        images[b"color"][...] = picture
        library.oidnExecuteFilter(filter_)
        _raise_error(library, device)
        return smooth.copy()

    weakref.finalize(denoise, library.oidnReleaseFilter, filter_)
    return denoise


def _raise_error(library: ctypes.CDLL, device: int) -> None:
    """Raise RenderError if the library has reported an error of the device since the last call."""
    message = _TEXT()
    if library.oidnGetDeviceError(device, ctypes.byref(message)):
        raise RenderError(f"Open Image Denoise: {(message.value or b'unknown error').decode(errors='replace')}")
