"""Finds the libraries with which Dr.Jit compiles Mitsuba's kernels: LLVM for the CPU, the driver of an NVIDIA GPU.

Backend `mitsuba` uses this to check, before a worker starts, that a device can be used on this machine.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import re
from pathlib import Path

from lookdev.errors import RenderError

LLVM_VARIABLE = "DRJIT_LIBLLVM_PATH"
"""The environment variable with the path of LLVM's library, which Dr.Jit reads."""

OLDEST_LLVM = 16
"""The first version that supports current processors: older versions abort on some of them."""

NEWEST_DEBIAN_LLVM = 19
"""The newest version of LLVM that both Debian 12 and 13 package; the package's name contains it."""

# Where Debian and Fedora install LLVM's library, below the root of the file system.
_FILES = ("usr/lib/*/libLLVM*.so*", "usr/lib/llvm-*/lib/libLLVM*.so*", "usr/lib64/libLLVM*.so*")
_VERSION = re.compile(r"(?:libLLVM-|\.so\.)(\d+)")


def check_device(device: str) -> None:
    """Raise RenderError if Mitsuba cannot compile kernels for a device, ``"cpu"`` or ``"cuda"``, on this machine."""
    if device == "cpu":
        find_llvm()
    elif (fault := gpu_fault()) is not None:
        raise RenderError(f'device = "{device}": {fault}; device = "cpu" would be right')


def gpu_fault() -> str | None:
    """Ask the driver whether an NVIDIA GPU can be used here; return None if so, otherwise the reason why not."""
    count = ctypes.c_int(0)
    try:
        driver = ctypes.CDLL("libcuda.so.1")
    except OSError:
        return "no driver of an NVIDIA GPU is installed here (libcuda.so.1)"
    if driver.cuInit(0) or driver.cuDeviceGetCount(ctypes.byref(count)) or not count.value:
        return "the driver finds no NVIDIA GPU here"
    return None


def find_llvm(root: Path = Path("/")) -> str:
    """Return the path of LLVM's library: the value of `LLVM_VARIABLE`, or the newest in Debian's and Fedora's folders.

    Dr.Jit's own search misses some file names of these distributions. Raises RenderError where Mitsuba or LLVM is not
    installed.
    """
    if importlib.util.find_spec("mitsuba") is None:
        raise RenderError("Mitsuba is not installed: pip install 'lookdev[mitsuba]'")
    if library := os.environ.get(LLVM_VARIABLE):
        return library
    libraries = {}
    for file in (path for pattern in _FILES for path in root.glob(pattern)):
        if match := _VERSION.search(file.name):
            libraries[int(match[1])] = file
    if not libraries or max(libraries) < OLDEST_LLVM:
        versions = f"found: version {max(libraries)}" if libraries else "found: none"
        package = f"libllvm{NEWEST_DEBIAN_LLVM}"
        raise RenderError(
            f"Mitsuba compiles its kernels by LLVM {OLDEST_LLVM} or newer, {versions}: install it (on Debian "
            f"{package}), or name the file of its library by {LLVM_VARIABLE}"
        )
    return str(libraries[max(libraries)])
