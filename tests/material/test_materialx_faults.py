"""Broken and hostile MaterialX documents end in errors with their place, and soon."""

from __future__ import annotations

import random
import time
from pathlib import Path

import pytest
from materialx_documents import IMAGE, MATERIAL, document, faults_of, setting

from lookdev.errors import LookError
from lookdev.material.materialx import import_materialx, write_usda


def loop(*names: str) -> str:
    """Nodes of which each is connected to the next, and the last to the first."""
    links = zip(names, (*names[1:], names[0]), strict=True)
    return "".join(
        f'<invert name="{a}" type="float"><input name="in" type="float" nodename="{b}"/></invert>' for a, b in links
    )


@pytest.mark.parametrize(
    ("inputs", "nodes", "expected"),
    [
        (setting("sheen", 'value="much"'), "", ("S/sheen", "'much' is not a value")),
        (setting("sheen", 'value="nan"'), "", ("S/sheen", "'nan' is not a value")),
        (setting("sheen", 'value="1e30"'), "", ("S/sheen", "'1e30' is not a value")),
        (setting("baseColor", 'value="1, 0"'), "", ("S/baseColor", "'1, 0' is not a value")),
        (setting("sheen", 'value="1"', "color3"), "", ("S/sheen", "has type 'color3'")),
        (setting("sheen", 'nodename="none"'), "", ("S/sheen", "is connected to 'none', which is not there")),
        (setting("sheen", 'nodename="M"'), "", ("M", "its connections run in a cycle")),
        (setting("sheen", 'nodegraph="G" output="o"'), "", ("S/sheen", "is connected to 'G.o', which is not there")),
        (setting("sheen", 'interfacename="i"'), "", ("S/sheen", "is connected to 'i', which is not there")),
        (setting("sheen", 'nodename="a"'), loop("a"), ("a", "its connections run in a cycle")),
        (setting("sheen", 'nodename="a"'), loop("a", "b", "c"), ("a", "its connections run in a cycle")),
        (
            setting("sheen", 'nodegraph="G" output="o"'),
            '<nodegraph name="G"><output name="o" type="float" output="o"/></nodegraph>',
            ("S/sheen", "its connections run in a cycle"),
        ),
        (
            setting("baseColor", 'nodename="image"'),
            IMAGE.format('<input name="uaddressmode" type="string" value="tile"/>'),
            ("image/uaddressmode", "unknown value 'tile'"),
        ),
        (
            setting("baseColor", 'nodename="image"'),
            IMAGE.format('<input name="texcoord" type="vector2" nodename="p"/>')
            + '<place2d name="p" type="vector2"><input name="scale" type="vector2" value="0, 1"/></place2d>',
            ("p", "has a scale of 0"),
        ),
        (
            setting("baseColor", 'nodename="image"'),
            IMAGE.format('<input name="texcoord" type="vector2" nodename="p"/>')
            + '<place2d name="p" type="vector2"><input name="operationorder" type="integer" value="2"/></place2d>',
            ("p/operationorder", "unknown value '2'"),
        ),
    ],
)
def test_a_broken_document_is_an_error_at_its_place(
    tmp_path: Path, inputs: str, nodes: str, expected: tuple[str, str]
) -> None:
    assert expected in [(where, what) for where, what, _ in faults_of(document(tmp_path, inputs, nodes=nodes))]


def test_all_faults_are_reported_at_once(tmp_path: Path) -> None:
    file = document(tmp_path, setting("sheen", 'value="x"'), setting("metallic", 'value="y"'))
    assert [where for where, _, _ in faults_of(file)] == ["S/metallic", "S/sheen"]


def test_other_shading_models_are_named(tmp_path: Path) -> None:
    other = '<standard_surface name="O" type="surfaceshader"/>'
    empty = '<surfacematerial name="E" type="material"/>'
    file = document(tmp_path, nodes=other, material=MATERIAL.replace('nodename="S"', 'nodename="O"') + empty)
    hint = "only disney_principled is imported; "
    hint += "the document itself, as 'material' of a look in a job, is read whatever its model"
    assert faults_of(file) == [
        ("M", "has the surface shader <standard_surface>", hint),
        ("E", "has no surface shader", hint),
    ]
    ((where, what, hint),) = faults_of(document(tmp_path, material=""))
    assert (where, what) == ("", "holds no surfacematerial")
    assert "disney_principled" in hint


LAUGHS = "".join(f'<!ENTITY a{i + 1} "{f"&a{i};" * 10}">' for i in range(9))
LAUGHS = f'<!DOCTYPE x [<!ENTITY a0 "ha">{LAUGHS}]><materialx version="1.39" doc="&a9;"/>'


@pytest.mark.parametrize(
    ("text", "where", "what"),
    [
        (b"", "line 1, column 1", "is not XML: no element found"),
        (b"#usda 1.0", "line 1, column 1", "is not XML: syntax error"),
        (b"<materialx version='1.39'>\n <image", "line 2, column 2", "is not XML: unclosed token"),
        (b"<materialx version='1.39' doc='\xff'/>", "line 1, column 32", "not UTF-8 text"),
        (b"<html/>", "line 1, column 1", "the document is <html>, not <materialx>"),
        (b"<materialx/>", "line 1, column 1", "MaterialX version ''"),
        (b"<materialx version='1.37'/>", "line 1, column 1", "MaterialX version '1.37'"),
        (b"<materialx version='9.1'/>", "line 1, column 1", "MaterialX version '9.1'"),
        (b"<materialx version='one'/>", "line 1, column 1", "MaterialX version 'one'"),
        (
            b"<materialx version='1.39'><a name='n'/>\n<b name='n'/></materialx>",
            "line 2, column 1",
            "a second element here is named 'n'",
        ),
        (LAUGHS.encode(), "line 1, column 13", "has a document type definition"),
        (
            b"<materialx version='1.39'>" + b"<a>" * 300_000,
            "line 1, column 120",
            "more than 32 elements inside each other",
        ),
    ],
)
def test_what_is_no_materialx_is_refused(tmp_path: Path, text: bytes, where: str, what: str) -> None:
    file = tmp_path / "m.mtlx"
    file.write_bytes(text)
    assert [fault[:2] for fault in faults_of(file)] == [(where, what)]


def test_missing_files_and_folders(tmp_path: Path) -> None:
    for file, what in (
        (tmp_path / "none.mtlx", "cannot be read: No such file or directory"),
        (tmp_path, "is a folder"),
    ):
        assert [fault[:2] for fault in faults_of(file)] == [("", what)]


@pytest.mark.parametrize("version", ["1.38", "1.39"])
@pytest.mark.parametrize("closed", [True, False])
def test_a_megabyte_of_nodes_ends_soon(tmp_path: Path, version: str, closed: bool) -> None:
    names = [f"n{i}" for i in range(14_000)]
    nodes = loop(*names) if closed else loop(*names).replace(' nodename="n0"', ' value="0"')
    file = document(tmp_path, setting("sheen", 'nodename="n0"'), nodes=nodes, attributes=f'version="{version}"')
    assert file.stat().st_size > 1_000_000
    before = time.process_time()
    if closed:
        assert "its connections run in a cycle" in faults_of(file)[0][1]
    else:
        assert len(import_materialx(file).unmapped) == len(names) + 1
    # A second is what it may take; a busy machine's caches are allowed for. Upgrading such a file took 150 s.
    assert time.process_time() - before < 5.0


def test_damaged_documents_end_in_looks_or_in_errors(tmp_path: Path) -> None:
    rng = random.Random(5)
    whole = document(
        tmp_path, setting("baseColor", 'nodename="image"'), setting("sheen", 'value="0.5"'), nodes=IMAGE.format("")
    )
    text = whole.read_text()
    errors: list[LookError] = []
    for _ in range(150):
        start, length = rng.randrange(len(text)), rng.randrange(1, 12)
        junk = rng.choice(["", text[start:][:length] * 2, "".join(rng.choices('<>/"=&;SM.0-9\u00e4', k=length))])
        whole.write_text(text[:start] + junk + text[start + length :], encoding="utf-8")
        try:
            write_usda(import_materialx(whole), whole.with_suffix(".usda"), replace=True)
        except LookError as error:
            errors.append(error)
    assert 0 < len(errors) < 150
    assert all(fault.what for error in errors for fault in error.faults)
