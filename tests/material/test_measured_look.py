"""Looks of measured reflectance: read from USD, imported, previewed, and in generated code."""

from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from look_files import LAYER1, faults_of, shader, stack

from lookdev.brdf import evaluate
from lookdev.brdf.measured import proposal
from lookdev.brdf.measured.files import write_anisotropic
from lookdev.codegen.nodes.exact import generate_nodes_exact
from lookdev.codegen.nodes.look import generate_nodes
from lookdev.codegen.osl.surface import generate_surface
from lookdev.codegen.setting import SourceSetting
from lookdev.codegen.source import TANGENT
from lookdev.errors import CodegenError, LookError, ModelError
from lookdev.light import Dome
from lookdev.material.library.edit import measured_look
from lookdev.material.library.preview import preview_values
from lookdev.material.usd import read_look
from lookdev.material.values import look_bsdf
from lookdev.scene import Sampling

_WO, _WI = np.array([0.0, 0.6, 0.8]), np.array([0.6, 0.0, 0.8])
_LIGHT: Any = Dome(None, None, None, None, 8, 4, "")  # type: ignore[arg-type]


def measured_shader(name: str = "Base", body: str = "asset file = @./even.dat@") -> str:
    return shader(name, "LookdevMeasured", body)


def write_even_table(file: Path, value: tuple[float, float, float]) -> Path:
    write_anisotropic(file, np.broadcast_to(value, (3, 3, 4, 4, 3)))
    return file


@pytest.fixture(autouse=True)
def _files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Of an even surface every view is alike: 4 tables in place of 256 are the same, in a sixtieth of the time. They are
    # kept here alone: other tests take those of the built-in measurement in full.
    monkeypatch.setattr(proposal, "_VIEW_CELLS", {False: (2, 1), True: (2, 2)})
    monkeypatch.setattr("lookdev.brdf.measured._make_cached_proposal", lru_cache(proposal.make_proposal))
    write_even_table(tmp_path / "even.dat", (0.1, 0.2, 0.3))
    write_even_table(tmp_path / "other.dat", (0.3, 0.2, 0.1))


def f_of(file: Path) -> Any:
    return evaluate(look_bsdf(read_look(file), None), _WO, _WI)  # type: ignore[arg-type]


def test_a_file_is_relative_to_the_look(write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = write(measured_shader())
    monkeypatch.chdir("/")
    (layer,) = read_look(file).layers
    assert layer.inputs == {"file": str(tmp_path / "even.dat")}
    np.testing.assert_allclose(f_of(file), (0.1, 0.2, 0.3), rtol=1e-6)


def test_the_built_in_measurement_is_no_file(write) -> None:
    file = write(measured_shader(body="asset file = @builtin:plastic@\nfloat scale = 2"))
    assert read_look(file).layers[0].inputs == {"file": "builtin:plastic", "scale": 2.0}
    assert (f_of(file) > 0.0).all()


@pytest.mark.parametrize(
    ("body", "name", "expected_summary"),
    [
        ("", "file", "names no file"),
        ("asset file = @@", "file", "names no file"),
        ("asset file = @./gold.binary@", "file", "no such file: ./gold.binary"),
        ("asset file = @./gray.png@", "file", "gray.png: is not a file of measured reflectance"),
        ('token file = "even.dat"', "file", "has type token"),
        ("asset file <- Base.layer", "file", "is computed by </M/Base>"),
        ('asset file = @./even.dat@; token interpolation = "cubic"', "interpolation", "cub"),
    ],
)
def test_a_wrong_file_is_a_fault_of_its_input(write, body: str, name: str, expected_summary: str) -> None:
    (path, summary, hint), *_ = faults_of(write(measured_shader(body=body)))
    assert path == f"Base.{name}"
    assert expected_summary in summary
    assert hint


def test_layers_of_different_files_are_blended_by_the_mask(write) -> None:
    inputs = f"token base <- Base.layer\n{LAYER1}float inputs:layer1Mask = 0.25"
    top = measured_shader("Coat", "asset file = @./other.dat@")
    file = write(measured_shader() + stack(inputs, top), terminal="</M/Layers.outputs:surface>")
    np.testing.assert_allclose(f_of(file), (0.15, 0.2, 0.25), rtol=1e-6)


def test_an_imported_file_is_a_look(tmp_path: Path) -> None:
    (tmp_path / "looks").mkdir()
    look = tmp_path / "looks" / "even_paint.usda"
    assert measured_look(look, tmp_path / "even.dat") == "/EvenPaint"
    assert "@../even.dat@" in look.read_text()
    np.testing.assert_allclose(f_of(look), (0.1, 0.2, 0.3), rtol=1e-6)
    with pytest.raises(LookError, match="exists already"):
        measured_look(look, tmp_path / "even.dat")
    with pytest.raises(ModelError, match=r"none.binary: no such file"):
        measured_look(tmp_path / "none.usda", tmp_path / "none.binary")
    assert not (tmp_path / "none.usda").exists()


def test_the_preview_has_the_mean_albedo(write) -> None:
    values = preview_values(read_look(write(measured_shader())).layers)
    np.testing.assert_allclose(values["diffuseColor"], np.pi * np.array([0.1, 0.2, 0.3]), rtol=2e-2)
    assert values["ior"] == 1.0


def source(file: Path) -> Any:
    sampling = Sampling(brdf_samples=2, ibl_samples=0, bounces=0)
    return generate_surface(read_look(file), SourceSetting((_LIGHT,), (8, 8), sampling))


def test_a_digest_depends_on_the_samples_not_on_their_path(write, tmp_path: Path) -> None:
    file = write(measured_shader())
    before = source(file).digest
    write_even_table(tmp_path / "even.dat", (0.1, 0.2, 0.4))
    assert source(file).digest != before
    write_even_table(tmp_path / "copy.dat", (0.1, 0.2, 0.3))
    assert source(write(measured_shader(body="asset file = @./copy.dat@"))).digest == before


def test_the_shader_has_each_table_once(write) -> None:
    generated = source(write(measured_shader()))
    names = [table.parameter for table in generated.tables]
    assert len(names) == len(set(names)) == 6
    assert all(f"float {name}[" in generated.osl for name in names)
    assert [attribute.attribute for attribute in generated.attributes] == [TANGENT]
    # MERL's data have no direction, so no tangent is read.
    assert not source(write(measured_shader(body="asset file = @builtin:plastic@"))).attributes


def test_nodes_cannot_show_it(write) -> None:
    look = read_look(write(measured_shader()))
    with pytest.raises(CodegenError, match=r"no closures of Cycles stand for lobe 'measured'.* 'exact'"):
        generate_nodes(look, lambda texture: Path())
    with pytest.raises(CodegenError, match="nodes cannot look up measured data; backend 'exact' would be right"):
        generate_nodes_exact(look, lambda texture: Path(), bounces=0)
