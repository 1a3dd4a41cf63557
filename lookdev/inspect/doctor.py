"""Checks, for `lookdev doctor`, that this machine can render; reports missing things, and how to get them."""

from __future__ import annotations

import ctypes
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module, metadata

from lookdev.cache import cache_dir, write_file
from lookdev.errors import OutputError, RenderError
from lookdev.rendering.llvm import NEWEST_DEBIAN_LLVM, find_llvm, gpu_fault
from lookdev.safe_text import align_columns

BLENDER_PYTHONS = {(3, 11): "4.5", (3, 13): "5.2"}
"""The version of Blender for each version of Python.

A wheel of bpy fits exactly one Python (VFX Reference Platform CY2025 and CY2026).
"""

MODULES = {
    **{name: name for name in ("numpy", "OpenEXR", "OpenImageIO", "pydantic", "rich", "scipy", "typer")},
    "OpenColorIO": "PyOpenColorIO",
    "usd-core": "pxr.Usd",
}
"""For each distribution, a module that only a complete installation can import; bpy is checked in its own process."""

SYSTEM_LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libICE.so.6": "libice6",
    "libSM.so.6": "libsm6",
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1",
    "libstdc++.so.6": "libstdc++6",
    "libxkbcommon.so.0": "libxkbcommon0",
}
"""The system libraries that bpy 4.5 and 5.2 load (by ldd) and that a bare Debian may lack, with their packages."""

FREE_DISK = 2.0
"""The free disk space, in GB, that a job needs: cached geometry, textures and lights, and a few hundred frames."""

SELF_TEST = (sys.executable, "-m", "lookdev.cycles", "--self-test")
IMPORT_BPY = (sys.executable, "-c", "import bpy; print(bpy.app.version_string)")


@dataclass(frozen=True)
class DoctorFinding:
    """The result of one check: the subject, its state, whether the state is good, and a remedy if it is not."""

    subject: str
    state: str
    good: bool
    remedy: str = ""


def examine_machine(
    import_bpy: Sequence[str] = IMPORT_BPY, self_test: Sequence[str] = SELF_TEST
) -> Iterator[DoctorFinding]:
    """Check everything that a render needs, in order of cost, and yield a finding for each check.

    `import_bpy` is a command that prints bpy's version, and `self_test` one that evaluates an OSL shader in Cycles.
    Both load Blender; tests replace them.
    """
    yield _check_python()
    for distribution, module in MODULES.items():
        yield _check_module(distribution, module)
    if sys.platform == "linux":
        yield _check_system_libraries(SYSTEM_LIBRARIES)
    cache = _check_cache()
    yield cache
    blender = _check_blender(import_bpy)
    yield blender
    if blender.good and cache.good:  # because the self-test writes a compiled shader to the cache
        yield _check_osl(self_test)
    yield _check_mitsuba()
    yield DoctorFinding("processor cores", str(os.cpu_count()), good=True)


def findings_text(findings: Sequence[DoctorFinding]) -> str:
    """Return findings as aligned lines. Each remedy is on a line of its own, so that it can be copied."""
    rows = []
    for finding in findings:
        rows.append(("ok     " if finding.good else "MISSING", finding.subject, finding.state))
        if finding.remedy:
            rows.append(("", "", f"to get it: {finding.remedy}"))
    return "\n".join(align_columns(rows))


def _check_python() -> DoctorFinding:
    """Check that a wheel of bpy exists for this version of Python."""
    version, good = sys.version_info[:2], sys.version_info[:2] in BLENDER_PYTHONS
    versions = ", ".join(f"{major}.{minor}" for major, minor in BLENDER_PYTHONS)
    remedy = "" if good else f"Blender's wheels exist for Python {versions}: make a venv with one"
    return DoctorFinding("Python", f"{version[0]}.{version[1]}", good, remedy)


def _check_module(distribution: str, module: str) -> DoctorFinding:
    """Check that a distribution is installed and its module can be imported."""
    try:
        import_module(module)
        return DoctorFinding(distribution, metadata.version(distribution), good=True)
    except (ImportError, metadata.PackageNotFoundError) as error:
        return DoctorFinding(distribution, str(error), good=False, remedy=f"python -m pip install {distribution}")


def _check_system_libraries(libraries: Mapping[str, str]) -> DoctorFinding:
    """Check that system libraries can be loaded; `libraries` has the Debian package of each."""
    missing = [name for name in libraries if not _can_load(name)]
    if not missing:
        return DoctorFinding("system libraries", f"{len(libraries)} of {len(libraries)}", good=True)
    remedy = f"sudo apt-get install {' '.join(sorted({libraries[name] for name in missing}))}"
    return DoctorFinding("system libraries", f"lacks {', '.join(missing)}", good=False, remedy=remedy)


def _can_load(library: str) -> bool:
    """Return whether the system's loader finds a library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _check_blender(command: Sequence[str]) -> DoctorFinding:
    """Import bpy in a separate process, because it may crash."""
    blender = BLENDER_PYTHONS.get(sys.version_info[:2])
    install = f"python -m pip install 'bpy=={blender}.*'" if blender else "another Python, see above"
    code, output, errors = _run_command(command)
    if code == 0:
        version = _last_line(output)
        good = blender is not None and version.startswith(blender)
        return DoctorFinding("bpy (Blender)", version, good, "" if good else install)
    packages = [package for library, package in SYSTEM_LIBRARIES.items() if library in errors]
    remedy = f"sudo apt-get install {' '.join(packages)}" if packages else install
    return DoctorFinding("bpy (Blender)", _last_line(errors) or f"exit code {code}", good=False, remedy=remedy)


def _check_osl(command: Sequence[str]) -> DoctorFinding:
    """Check that Cycles evaluates an OSL shader, by the command of the self-test, which prints JSON."""
    code, output, errors = _run_command(command)
    line = _last_line(output)
    if code == 0:
        with suppress(json.JSONDecodeError):
            json.loads(line)
            return DoctorFinding("OSL in Cycles", "renders", good=True)
    answer = f"answered {line!r}" if code == 0 else _last_line(errors) or f"exit code {code}"
    remedy = "reinstall bpy, or see: python -m lookdev.cycles --self-test"
    return DoctorFinding("OSL in Cycles", answer, good=False, remedy=remedy)


def _check_mitsuba() -> DoctorFinding:
    """Check the requirements of the optional backend `mitsuba`."""
    if importlib.util.find_spec("mitsuba") is None:
        return DoctorFinding("Mitsuba", "not installed; only backend 'mitsuba' needs it", good=True)
    gpu = gpu_fault() or "an NVIDIA GPU is there"
    try:
        version = f"""{metadata.version("mitsuba")}, {find_llvm()}; device = "cuda": {gpu}"""
        return DoctorFinding("Mitsuba", version, good=True)
    except RenderError as error:
        remedy = f"sudo apt-get install libllvm{NEWEST_DEBIAN_LLVM}"
        return DoctorFinding("Mitsuba", str(error), good=False, remedy=remedy)


def _check_cache() -> DoctorFinding:
    """Check that the cache folder can be written and has enough free space."""
    try:
        folder = cache_dir()
        write_file(folder / "doctor.txt", "can be written")
        (folder / "doctor.txt").unlink()
        free = shutil.disk_usage(folder).free / 1e9
    except (OSError, OutputError) as error:
        return DoctorFinding("cache folder", str(error), good=False, remedy="set LOOKDEV_CACHE to a writable folder")
    good = free >= FREE_DISK
    remedy = "" if good else f"free {FREE_DISK:g} GB, or set LOOKDEV_CACHE to a folder on another disk"
    return DoctorFinding("cache folder", f"{folder}, {free:.1f} GB free", good, remedy)


def _run_command(command: Sequence[str]) -> tuple[int, str, str]:
    """Run a command, for at most two minutes; return its exit code, standard output and standard error."""
    try:
        process = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        return 1, "", "no answer in 120 s"
    return process.returncode, process.stdout, process.stderr


def _last_line(text: str) -> str:
    """Return the last line of a text that is not blank, or ""."""
    return "".join(text.strip().splitlines()[-1:]).strip()
