"""Helpers of tests are imported by their bare names, from several folders at once."""

import sys
from collections import Counter
from pathlib import Path

TESTS = Path(__file__).parent


def test_no_two_modules_of_the_tests_share_a_name():
    names = Counter(path.stem for path in TESTS.rglob("*.py") if path.name != "conftest.py")
    assert not [name for name, count in names.items() if count > 1]


def test_no_module_of_the_tests_hides_another():
    others = sys.stdlib_module_names | {path.stem for path in TESTS.parent.iterdir() if path.is_dir()}
    assert not others & {path.stem for path in TESTS.rglob("*.py")}
