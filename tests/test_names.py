"""Helpers of tests are imported by their bare names, from several folders at once."""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parent


def test_no_two_modules_of_the_tests_share_a_name():
    names = Counter(path.stem for path in TESTS.rglob("*.py") if path.name != "conftest.py")
    assert not [name for name, count in names.items() if count > 1]


def test_what_one_python_leaves_out_needs_no_library_of_a_format_and_no_blender():
    marked = [path for path in TESTS.rglob("test_*.py") if "\npytestmark = pytest.mark.alike" in path.read_text()]
    assert marked
    needing = re.compile(r"^(import|from) (bpy|pxr|OpenEXR|OpenImageIO|MaterialX|embreex)|mark\.cycles", re.MULTILINE)
    assert not [path.name for path in marked if needing.search(path.read_text())]


def test_no_module_of_the_tests_hides_another():
    others = sys.stdlib_module_names | {path.stem for path in TESTS.parent.iterdir() if path.is_dir()}
    assert not others & {path.stem for path in TESTS.rglob("*.py")}
