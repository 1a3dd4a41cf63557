"""Runs of this folder's programs in separate processes, because they import bpy."""

import subprocess
import sys
from pathlib import Path


def run_script(name: str, *arguments: object) -> None:
    command = [sys.executable, str(Path(__file__).with_name(name)), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
