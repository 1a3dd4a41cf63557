"""Arcs to MaterialX documents compose: references, payloads, sublayers, in variants, binary layers and packages."""

from pathlib import Path

import pytest
from pxr import Sdf, Tf, UsdShade

from lookdev.errors import LookError
from lookdev.mtlx import is_document
from lookdev.stage import open_stage

DOCUMENT = """<materialx version="1.38">
  <image name="i" type="color3"><input name="file" type="filename" value="a.png"/></image>
  <standard_surface name="S" type="surfaceshader">
    <input name="base_color" type="color3" nodename="i"/></standard_surface>
  <surfacematerial name="Gold" type="material"><input name="surfaceshader" type="surfaceshader" nodename="S"/>
  </surfacematerial></materialx>"""

ARCS = {  # the metadata of a prim, and the path of the material
    "reference to the root": ("references = @./sub/x.mtlx@</MaterialX>", "/A/Materials/Gold"),
    "reference to the materials": ("prepend references = @./sub/x.mtlx@</MaterialX/Materials>", "/A/Gold"),
    "reference to a material": ("append references = @./sub/x.mtlx@</MaterialX/Materials/Gold>", "/A"),
    "reference to the default prim": ("references = @./sub/x.mtlx@", "/A/Materials/Gold"),
    "payload": ("payload = @./sub/x.mtlx@</MaterialX/Materials>", "/A/Gold"),
    "two references": ("references = [@./b.usda@</B>, @./sub/x.mtlx@</MaterialX/Materials>]", "/A/Gold"),
}
IN_A_VARIANT = """def "A" (
 variants = { string v = "a" }
 prepend variantSets = "v"
)
{
 variantSet "v" = {
  "a" ( prepend references = @./sub/x.mtlx@</MaterialX/Materials> )
  {
  }
 }
}"""


def prim(metadata: str) -> str:
    return f'def "A" (\n {metadata}\n)\n{{\n}}'


def write(folder: Path, text: str) -> Path:
    (folder / "sub").mkdir()
    (folder / "sub" / "x.mtlx").write_text(DOCUMENT)
    (folder / "sub" / "a.png").write_bytes(b"no image, but a file")
    (folder / "b.usda").write_text('#usda 1.0\ndef "B"\n{\n}\n')
    file = folder / "asset.usda"
    file.write_text(f"#usda 1.0\n{text}\n")
    return file


def assert_composed(file: Path, path: str, folder: Path) -> None:
    stage = open_stage(file)
    assert not stage.GetCompositionErrors()
    shader, _, _ = UsdShade.Material(stage.GetPrimAtPath(path)).ComputeSurfaceSource("mtlx")
    assert shader.GetPath() == f"{path}/S"
    (source,) = shader.GetInput("base_color").GetValueProducingAttributes()
    image = stage.GetPrimAtPath(source.GetPrimPath()).GetAttribute("inputs:file").Get()
    assert image.resolvedPath == str(folder / "sub" / "a.png")


CASES = {name: (prim(metadata), path) for name, (metadata, path) in ARCS.items()} | {
    "in a variant": (IN_A_VARIANT, "/A/Gold"),
    "sublayer": ("(\n subLayers = [@./sub/x.mtlx@]\n)", "/MaterialX/Materials/Gold"),
}


@pytest.mark.parametrize(("text", "path"), CASES.values(), ids=CASES)
@pytest.mark.parametrize("binary", [False, True])
def test_arcs(tmp_path: Path, text: str, path: str, binary: bool) -> None:
    file = write(tmp_path, text)
    if binary:
        Sdf.Layer.FindOrOpen(str(file)).Export(str(file.with_suffix(".usdc")))
        file = file.with_suffix(".usdc")
    assert_composed(file, path, tmp_path)


def test_an_arc_in_a_referenced_layer(tmp_path: Path) -> None:
    write(tmp_path, prim(ARCS["payload"][0]))
    outer = tmp_path / "outer.usda"
    outer.write_text('#usda 1.0\ndef "O" (\n references = @./asset.usda@</A>\n instanceable = true\n)\n{\n}\n')
    assert_composed(outer, "/O/Gold", tmp_path)


def test_the_document_itself(tmp_path: Path) -> None:
    write(tmp_path, "")
    assert_composed(tmp_path / "sub" / "x.mtlx", "/MaterialX/Materials/Gold", tmp_path)


def test_a_package(tmp_path: Path) -> None:
    write(tmp_path, "")
    inner = tmp_path / "inner.usda"
    inner.write_text(f"#usda 1.0\n{prim(ARCS['reference to the materials'][0])}\n")
    (tmp_path / "root.usda").write_text(f"#usda 1.0\n{prim('references = @inner.usda@</A>')}\n")
    writer = Sdf.ZipFileWriter.CreateNew(str(tmp_path / "a.usdz"))
    for name in ("root.usda", "inner.usda", "sub/x.mtlx", "sub/a.png"):
        writer.AddFile(str(tmp_path / name), name)
    writer.Save()
    stage = open_stage(tmp_path / "a.usdz")
    assert not stage.GetCompositionErrors()
    assert stage.GetAttributeAtPath("/A/Gold/i.inputs:file").Get().resolvedPath == f"{tmp_path / 'a.usdz'}[sub/a.png]"


def test_a_layer_that_is_redirected_cannot_be_saved(tmp_path: Path) -> None:
    file = write(tmp_path, prim(ARCS["payload"][0]))
    before = file.read_text()
    stage = open_stage(file)
    with pytest.raises(Tf.ErrorException):
        stage.GetRootLayer().Save()
    assert file.read_text() == before


def test_a_missing_document_is_a_composition_error(tmp_path: Path) -> None:
    file = write(tmp_path, prim(ARCS["payload"][0]).replace("x.mtlx", "none.mtlx"))
    (error,) = open_stage(file).GetCompositionErrors()
    assert "none.mtlx" in str(error)


def test_a_malformed_document_is_an_error_with_its_place(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = write(tmp_path, prim(ARCS["payload"][0]))
    (tmp_path / "sub" / "x.mtlx").write_text("<materialx version='1.38'>\n<image")
    with pytest.raises(LookError) as caught:
        open_stage(file)
    ((fault),) = caught.value.faults
    assert (fault.file, fault.where) == (str(tmp_path / "sub" / "x.mtlx"), "line 2, column 1")
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("path", "expected"), [("a.mtlx", True), ("a.MTLX", True), ("a.usdz[b.mtlx]", True), ("a.usda", False), ("", False)]
)
def test_documents_by_name(path: str, expected: bool) -> None:
    assert is_document(path) is expected
