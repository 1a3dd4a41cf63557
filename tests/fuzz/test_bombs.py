"""Small files that crash, stall or swell what reads them end the command line with a message that names them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from bombs import BOMBS
from pictures import job, table

from lookdev.guard import MEMORY_VARIABLE, SECONDS_VARIABLE

_LIMITS = {MEMORY_VARIABLE: "1024", SECONDS_VARIABLE: "8"}


@pytest.mark.proof
@pytest.mark.parametrize("name", BOMBS)
def test_a_bomb_is_refused_by_name(tmp_path: Path, name: str) -> None:
    file = BOMBS[name](tmp_path)
    (tmp_path / "job.toml").write_text(job(table(usd=file.name)))
    done = subprocess.run(
        (sys.executable, "-m", "lookdev", "plan", str(tmp_path / "job.toml")),
        capture_output=True,
        text=True,
        env=os.environ | _LIMITS,
        timeout=60.0,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert str(file) in done.stderr
    assert len(done.stderr) < 2000
