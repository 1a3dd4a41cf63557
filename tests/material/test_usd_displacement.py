"""Displacement of looks: what `outputs:lookdev:displacement` leads to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from look_files import disney, faults_of, look, shader, texture

from lookdev.material import Displacement
from lookdev.material.look import Formula, Primvar, Texture
from lookdev.material.usd import read_look

Write = Callable[..., Path]

TERMINAL = "token outputs:lookdev:displacement.connect = </M/Moved.outputs:displacement>\n"


def displaced(inputs: str, more: str = "") -> str:
    return TERMINAL + disney() + shader("Moved", "LookdevDisplacement", inputs) + more


def test_a_look_without_displacement_has_none(write: Write) -> None:
    assert read_look(write(disney())).displacement is None


def test_a_constant_and_all_settings(write: Write) -> None:
    inputs = """float height = 0.5
    float scale = -2
    float midlevel = 0.25
    token units = "world" """
    assert read_look(write(displaced(inputs))).displacement == Displacement(0.5, -2.0, 0.25, "world")


def test_defaults(write: Write) -> None:
    assert read_look(write(displaced("float height = 7"))).displacement == Displacement(7.0, 1.0, 0.0, "object")


@pytest.mark.parametrize(
    ("output", "more", "kind"),
    [
        ("Tex.outputs:g", texture(), Texture),
        ("P.outputs:result", shader("P", "UsdPrimvarReader_float", 'string varname = "h"'), Primvar),
        ("X.outputs:result", shader("X", "LookdevExpression", 'string expression = "2 - 5"'), Formula),
    ],
)
def test_heights_come_from_nodes(write: Write, output: str, more: str, kind: type) -> None:
    found = read_look(write(displaced(f"float inputs:height.connect = </M/{output}>", more))).displacement
    assert found is not None
    assert isinstance(found.height, kind)


@pytest.mark.parametrize(
    ("body", "where", "what"),
    [
        ("token outputs:lookdev:displacement\n" + disney(), "/M.outputs:lookdev:displacement", "is not connected"),
        (
            TERMINAL.replace("Moved", "Base") + disney(),
            "/M.outputs:lookdev:displacement",
            "has the unknown info:id 'LookdevDisney'",
        ),
        (TERMINAL + disney(), "/M.outputs:lookdev:displacement", "is no output of a shader"),
        (displaced(""), "/M/Moved.inputs:height", "is neither set nor connected"),
        (displaced("color3f height = (1, 1, 1)"), "/M/Moved.inputs:height", "has type color3f"),
        (displaced("float height = nan"), "/M/Moved.inputs:height", "nan is not finite"),
        (displaced("float height = 1\nfloat scale = inf"), "/M/Moved.inputs:scale", "inf is not finite"),
        (displaced("float height = 1\nfloat sacle = 1"), "/M/Moved.inputs:sacle", "unknown input"),
        (displaced('float height = 1\ntoken units = "feet"'), "/M/Moved.inputs:units", "unknown value"),
        (displaced("float height <- Tex.rgb", texture()), "/M/Moved.inputs:height", "cannot use </M/Tex.outputs:rgb>"),
        (
            displaced("float inputs:height.connect = </M/Moved.inputs:height>"),
            "/M/Moved.inputs:height",
            "which is no output of a shader",
        ),
        (
            displaced("float height = 1\nfloat scale <- Tex.r", texture()),
            "/M/Moved.inputs:scale",
            "it must be a constant",
        ),
        (
            displaced(
                "float height <- X.result",
                shader("X", "LookdevExpression", 'string expression = "0.1 * view"\nfloat outputs:result'),
            ),
            "/M/Moved.inputs:height",
            "depends on the view",
        ),
    ],
)
def test_faults(tmp_path: Path, write: Write, body: str, where: str, what: str) -> None:
    write(body)
    (tmp_path / "look.usda").write_text(look(body))
    found = faults_of(tmp_path / "look.usda")
    assert any(place == where and what in f"{said} ({hint})" for place, said, hint in found), found
