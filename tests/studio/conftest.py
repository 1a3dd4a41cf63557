"""Fixtures: a served Explorer, looks, jobs, and a folder of measured data."""

import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from lookdev.brdf.measured.files import MERL_SIZE, write_merl

pytest.importorskip("starlette", reason="the page's packages are not installed: pip install 'lookdev[studio]'")

from served import Served, start_server
from usd_text import job_toml

MATERIALS = Path(__file__).parents[2] / "materials"


@pytest.fixture(scope="session")
def car_paint() -> Callable[[Path], Path]:
    """Return a function that writes car paint into a folder: flakes and a muted dust over a base.

    It has no clear coat, and no metal: its shaders are half as long.
    """
    text = re.sub(r" +float inputs:(clearcoat\w*|metallic) = .*\n", "", (MATERIALS / "car_paint.usda").read_text())

    def copy(folder: Path) -> Path:
        shutil.copytree(MATERIALS / "textures", folder / "textures")
        (folder / "car_paint.usda").write_text(text)
        return folder / "car_paint.usda"

    return copy


@pytest.fixture(scope="session")
def white_job() -> Callable[[Path, str, str], Path]:
    """Return a function that writes a job of an asset and a look of its folder, in uniform light.

    Such light needs no tables, and programs compile in less than half of the time.
    """

    def write(folder: Path, asset: str, material: str) -> Path:
        render = '{ resolution = [32, 24], samples = 16, backend = "mitsuba" }'
        text = job_toml(f"plastic = {material}", asset=f'{{ builtin = "{asset}" }}', render=render)
        (folder / "job.toml").write_text(text)
        return folder / "job.toml"

    return write


@pytest.fixture(scope="session")
def toy_car() -> str:
    """Return the text of the toy car, of 8 thousand triangles instead of 300 thousand."""
    text = (MATERIALS.parent / "jobs" / "assets" / "toy_car.usda").read_text()
    return re.sub("def (Sphere|Cone)", "def Cylinder", text.replace('"catmullClark"', '"none"'))


@pytest.fixture(scope="session")
def roots(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a measurement, isotropic since that is four times as fast, and a secret beside it."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / "secret.dat").write_text("secret")
    root = folder / "scans"
    root.mkdir()
    grey = np.random.default_rng(3).uniform(0.1, 0.4, (*MERL_SIZE[:2], 1, 1))
    write_merl(root / "satin.binary", np.broadcast_to(grey, (*MERL_SIZE, 3)))
    (root / "out.dat").symlink_to(folder / "secret.dat")
    return root


@pytest.fixture(scope="session")
def server(roots: Path) -> Iterator[Served]:
    with start_server("--root", str(roots), "disney:roughness=.3") as started:
        yield started
