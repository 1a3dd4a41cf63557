"""Runs of one job that are killed, stopped and kept from writing, again and again, end with the same bytes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).with_name("storm.py")


@pytest.mark.parametrize("kills", [20, pytest.param(1000, marks=pytest.mark.chaos)], ids=lambda kills: f"{kills} kills")
def test_a_storm_leaves_all_frames_and_nothing_else(kills: int) -> None:
    # A process of its own, as it forks: this one may have threads.
    ended = subprocess.run([sys.executable, str(PROGRAM), str(kills), "23"], capture_output=True, text=True)
    assert ended.returncode == 0, ended.stderr[-4000:]
    assert "'run killed'" in ended.stdout
