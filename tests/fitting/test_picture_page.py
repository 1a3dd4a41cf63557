"""The page of a fit to a picture: one file that stands alone, with all text escaped."""

import base64
import re
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from jinja2 import UndefinedError
from matplotlib.image import imread

from lookdev.fitting.picture.page import FitPictures, table_rows, write_page
from lookdev.fitting.picture.search import LossPoint, SearchResult
from lookdev.html_page import write_html_page

NAME = "<b>\"paint\" & 'base'"
ESCAPED = "&lt;b&gt;&#34;paint&#34; &amp; &#39;base&#39;"
CURVE = (
    LossPoint("start", 0, 3.0), LossPoint("start", 1, 2.0), LossPoint("follow", 0, 1.0),
    LossPoint("follow", 0, 1.5, False), LossPoint("follow", 0, 0.5),
    LossPoint("follow", 1, 0.8), LossPoint("follow", 1, 0.7), LossPoint("refine", 0, 0.1),
)  # fmt: skip


@pytest.fixture
def page(tmp_path: Path) -> str:
    photo, noise = np.random.default_rng(1).random((6, 8, 3)), np.full((6, 8, 3), 0.1)
    broken = np.where(np.arange(8)[:, None] == 2, np.nan, photo)
    pictures = FitPictures(photo, broken, photo, noise, noise, np.arange(8) > np.zeros((6, 1)) + 3)
    found = SearchResult(
        values={NAME: (0.8, 0.2, 0.1), "roughness": (0.3,)},
        errors={NAME: (0.01, 0.02, 0.03), "roughness": (float("nan"),)},
        without_effect=(),
        undetermined=("roughness",),
        correlated_pairs=(),
        before=3.0,
        after=0.1,
        noise=0.05,
        misfit=1.0,
        starts=((0.1, True),),
        curve=CURVE,
        pictures=(photo, photo),
        converged=False,
        interrupted=False,
        seconds=1.0,
    )
    rows = table_rows(found, {NAME: (0.5, 0.5, 0.5), "roughness": (0.5,)})
    write_page(tmp_path / "fit.html", NAME, [f"photo {NAME}\x1b"], pictures, rows, found)
    return (tmp_path / "fit.html").read_text(encoding="utf-8")


def test_text_is_escaped(page: str) -> None:
    assert f"<title>{ESCAPED}</title>" in page
    assert f"<h1>{ESCAPED}</h1>" in page
    assert f"<p>photo {ESCAPED}?</p>" in page
    assert f"<td>{ESCAPED}</td>" in page
    assert "<b>" not in page


def test_the_page_stands_alone(page: str) -> None:
    assert not re.search(r"<(script|link|iframe|object|embed)|url\(|@import|https?:", page)
    assert "default-src 'none'" in page
    sources = re.findall(r' src="data:image/png;base64,([^"]*)"', page)
    assert [imread(BytesIO(base64.b64decode(source)))[..., :3].shape for source in sources] == [(6, 8, 3)] * 5
    assert page.count(" src=") == len(sources)


def test_a_row_has_its_numbers_and_a_remark(page: str) -> None:
    assert re.search(r"rgb\(188, 188, 188\)\"></span> 0\.5, 0\.5, 0\.5</td>", page)
    assert "0.01, 0.02, 0.03</td><td></td>" in page
    assert "?</td><td>not determined by the picture</td>" in page
    assert page.count('class="note"') == 1


def test_the_chart_has_each_render_and_a_line_for_each_start(page: str) -> None:
    assert len(re.findall(r"<circle", page)) == len(CURVE) + 4  # the legend
    assert page.count('fill="none" stroke="#2a78c2"/>') == 1 + 2  # a rejected step, two lines
    paths = re.findall(r'<path d="M([^"]*)"', page)
    lines = [[float(number) for number in path.split()] for path in paths]
    assert [len(line) for line in lines] == [4, 4]
    assert all(64.0 < x < 884.0 for line in lines for x in line[::2])


def test_a_template_needs_all_its_values(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(
        "{% extends 'html_page.html' %}{% block style %}{% endblock %}{% block body %}{{ nothing }}{% endblock %}"
    )
    with pytest.raises(UndefinedError, match="'nothing' is undefined"):
        write_html_page(tmp_path / "out.html", tmp_path / "page.html", "title")
    assert not (tmp_path / "out.html").exists()
