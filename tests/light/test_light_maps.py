"""Maps in the cache: the same dome, repairs and faults, without reading pixels."""

import os
import shutil
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from light_cases import make_tables_small, write_exr

from lookdev.errors import EnvironmentMapError
from lookdev.light import load_environment, prepare_light
from lookdev.light.dome import maps
from lookdev.light.dome.maps import load_dome


@pytest.fixture(autouse=True)
def reads(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Path | None]:
    """The maps whose pixels are read, with a cache for this test."""
    make_tables_small(monkeypatch)
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    read: list[Path | None] = []
    record = lambda file, builtin: (read.append(file), load_environment(file, builtin))[1]  # noqa: E731
    monkeypatch.setattr(maps, "load_environment", record)
    return read


def painted(file: Path, value: float, *, first: float | None = None) -> Path:
    pixels = np.full((4, 8), value, np.float32)
    pixels[0, 0] = value if first is None else first
    header = {"compression": OpenEXR.NO_COMPRESSION}  # so that size does not depend on values
    return write_exr(file, header, R=pixels, G=pixels, B=pixels)


@pytest.mark.parametrize("first", [None, 2.0, -1.0], ids=["constant", "varied", "negative"])
def test_a_known_map_is_not_read_again(tmp_path: Path, reads: list[Path | None], first: float | None) -> None:
    file = painted(tmp_path / "sky.exr", 0.5, first=first)
    expected = load_environment(file)
    copy = Path(shutil.copy(file, tmp_path / "copy.exr"))
    maps = [load_dome(copy_file) for copy_file in (file, file, copy)]
    assert len(reads) == 1
    for copy_file in maps:
        assert (copy_file.dome, copy_file.repairs) == (prepare_light(expected), expected.repairs)
        assert copy_file.largest == expected.radiance.max()
        with pytest.raises(EnvironmentMapError, match=r"(sky|copy)\.exr: its largest radiance times 2\^90 is"):
            copy_file.check_exposed(90.0)


def test_the_content_decides_and_damage_is_repaired(tmp_path: Path, reads: list[Path | None]) -> None:
    file = painted(tmp_path / "sky.exr", 0.5, first=1.0)
    times, content, first = file.stat(), file.read_bytes(), load_dome(file)
    painted(file, 0.25, first=2.0)
    os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert file.stat().st_size == times.st_size
    assert load_dome(file).dome.map_digest != first.dome.map_digest
    assert len(reads) == 2
    file.write_bytes(content)
    assert load_dome(file) == first
    assert len(reads) == 2
    assert first.dome.slots_file is not None
    first.dome.slots_file.path.write_bytes(b"damaged")
    assert load_dome(file) == first
    assert first.dome.slots_file.is_whole()
    assert len(reads) == 3


def test_faults_are_those_of_reading(tmp_path: Path) -> None:
    for source in ({"file": tmp_path / "no.exr"}, {"builtin": "no"}, {}, {"file": tmp_path, "builtin": "city"}):
        with pytest.raises(EnvironmentMapError):
            load_dome(**source)
    with pytest.raises(EnvironmentMapError, match="its largest radiance is"):
        load_dome(painted(tmp_path / "bright.exr", 1e30))
