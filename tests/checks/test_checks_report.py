"""The report: a table, and a self-contained page."""

import base64
import io
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from rich.console import Console

from lookdev.checks.finding import CheckFinding, FindingPlot, PlotCurve, PlotImage
from lookdev.checks.report import draw_svg, print_findings, verdict, write_html

X = np.linspace(0.0, 1.0, 5)
CURVES = FindingPlot(
    "Albedo of $x",
    "angle",
    "albedo",
    (
        PlotCurve("band", X, X, X - 0.1, X + 0.1),
        PlotCurve("points", X, X, X - 0.1, X + 0.1, "points"),
        PlotCurve("counts", np.linspace(0.0, 1.0, 6), X, style="bars"),
    ),
)
PICTURES = FindingPlot(
    'Frame "1" <i>', pictures=(PlotImage("frame", np.zeros((4, 4, 3))), PlotImage("t", np.eye(4), -6.0, 6.0))
)
GOOD = CheckFinding("points", "gold", True, "40000 cases", {"cases": 4e4}, ("case 1",), (CURVES,))
WORST = "pixel [red]1,2[/red] " + "x" * 300
BAD = CheckFinding("image", "<b>gold</b>, city", False, "t 9 & more", {}, (WORST,), (PICTURES,))
SKIPPED = CheckFinding("albedo", "gold", True, "", skipped="no light passes through")


def print_text(*findings: CheckFinding) -> str:
    stream = io.StringIO()
    print_findings(findings, Console(file=stream, width=90))
    return stream.getvalue()


def test_the_table_has_every_finding_and_the_worst_cases_of_the_bad_ones() -> None:
    text = print_text(GOOD, BAD, SKIPPED)
    assert re.search(r"points +gold +agrees +40000 cases", text)
    assert re.search(r"image +<b>gold</b>, city +DISAGREES +t 9 & more", text)
    assert "skipped: no light passes through" in text
    assert "case 1" not in text
    # To be replayed a case must be one line, with nothing taken for markup.
    assert WORST in text.splitlines()


def test_the_verdict_counts() -> None:
    assert verdict([GOOD, SKIPPED]) == "all 2 checks agree"
    assert verdict([GOOD, BAD]) == "1 of 2 checks disagree"


def test_the_page_stands_alone(tmp_path: Path) -> None:
    write_html([GOOD, BAD, SKIPPED], tmp_path / "report.html", "check <gold>")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    for reference in re.findall(r'(?:src|href|action|data)="([^"]*)"', page):
        assert reference.startswith(("#finding", "data:image/svg+xml;base64,"))
    assert not re.search(r"<(script|link|iframe|object|embed)|url\(|@import|https?:", page)
    assert "default-src 'none'" in page
    assert "<title>check &lt;gold&gt;</title>" in page
    assert "&lt;b&gt;gold&lt;/b&gt;" in page
    assert 'alt="Frame &#34;1&#34; &lt;i&gt;"' in page
    drawings = re.findall(r"base64,([^\"]*)", page)
    assert len(drawings) == 2
    for drawing in drawings:
        root = ElementTree.fromstring(base64.b64decode(drawing))
        links = [value for element in root.iter() for name, value in element.attrib.items() if name.endswith("}href")]
        assert all(link.startswith(("#", "data:image/png;base64,")) for link in links)


def test_the_same_plot_gives_the_same_file() -> None:
    assert draw_svg(CURVES) == draw_svg(CURVES)
