"""A test process that is killed leaves no browser, no driver, no server, and no file of theirs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from batch_case import is_alive, wait_until
from served import descendants

HOLDER = """
from pathlib import Path
from served import start_server

def test_holds(tab):
    tab.get("about:blank")
    with start_server() as server:
        Path("held").touch()
        server.process.wait()
"""


@pytest.mark.both_pythons
def test_a_killed_test_process_leaves_nothing(browser: object, tmp_path: Path) -> None:
    """`browser` gives this test its mark, and its process of xdist; the killed test has a browser of its own."""
    (tmp_path / "test_holder.py").write_text(HOLDER)
    command = [sys.executable, "-m", "pytest", "-n", "0", "-p", "chromium", "--rootdir", str(tmp_path)]
    folders = os.pathsep.join(map(str, (Path(__file__).parents[1], Path(__file__).parent)))
    environment = os.environ | {"PYTHONPATH": folders}
    log, held = tmp_path / "log", tmp_path / "held"
    with log.open("w") as output:
        holder = subprocess.Popen(
            [*command, "--basetemp", str(tmp_path / "base"), str(tmp_path)],
            stdout=output, stderr=output, env=environment, cwd=tmp_path,
        )  # fmt: skip
    try:
        wait_until(lambda: held.exists() or holder.poll() is not None)
        below = descendants(holder.pid)
        for name in ("lifeline.py", "chromedriver --port", "--type=renderer", "lookdev explore"):
            assert any(name in line for line in below.values()), (name, below, log.read_text())
        driver = next(pid for pid, line in below.items() if Path(line.split()[0]).name == "chromedriver")
        variables = Path(f"/proc/{driver}/environ").read_text().split("\0")
        folder = next(
            Path(variable.removeprefix("TMPDIR=")) for variable in variables if variable.startswith("TMPDIR=")
        )
        assert list(folder.iterdir())
    finally:
        holder.kill()
        holder.wait()
    wait_until(lambda: not any(map(is_alive, below)))
    assert not folder.exists()
