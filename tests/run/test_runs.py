import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import batch_case as case
import pytest

from lookdev.errors import OutputError
from lookdev.run.runs import Run, RunInfo, Runs

# A program that is killed while it writes its file.
HALF = """
import os, sys
from pathlib import Path
from lookdev.cache import atomic_path
with atomic_path(Path(sys.argv[1])) as half:
    half.touch()
    os.kill(os.getpid(), 9)
"""
FRAME = "gold/city/element.0001"

pytestmark = pytest.mark.both_pythons  # processes, signals, and claims on disk


def state(out: Path) -> list[str]:
    return sorted(path.relative_to(out / ".lookdev").as_posix() for path in (out / ".lookdev").rglob("*"))


def test_a_claim_is_of_one_run_until_it_ends(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with case.hold_frame(out, FRAME) as other, Run(out) as run:
        assert [info.process for info in run.announce_plan("plan")] == [other.pid]
        assert not run.claim(FRAME)
        assert run.claim("gold/city/element.0002")
        other.communicate()
        assert run.claim(FRAME)
        assert run.others() == []
    assert state(out) == []


def test_a_killed_run_holds_nothing_and_leaves_nothing(tmp_path: Path) -> None:
    with case.hold_frame(tmp_path, FRAME) as other:
        other.kill()
    subprocess.run((sys.executable, "-c", HALF, str(tmp_path / ".lookdev/runs/0123456789abcdef")), check=False)
    assert len(state(tmp_path)) == 5
    with Run(tmp_path) as run:
        assert run.announce_plan("another plan") == []
        assert run.claim(FRAME)
    assert state(tmp_path) == []


@pytest.fixture
def _short_lease(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let other processes have six heartbeats a second, and count as dead here after half a second without one."""
    monkeypatch.setenv("LOOKDEV_LEASE", "1")
    monkeypatch.setattr("lookdev.run.runs.lease_seconds", lambda: 0.5)


@contextmanager
def dead_for_others(output: Path) -> Iterator[None]:
    with Run(output) as run:
        run._file.unlink()
        yield


@pytest.mark.usefixtures("_short_lease")
def test_a_run_that_stands_still_loses_its_claims_and_ends(tmp_path: Path) -> None:
    with case.hold_frame(tmp_path, FRAME) as other, Run(tmp_path) as run:
        other.send_signal(signal.SIGSTOP)
        case.wait_until(lambda: run.claim(FRAME))
        for failed in (OutputError("scratch-0: a frame cannot be written"), FileNotFoundError("scratch-0/frame.npz")):
            # Its scratch files are gone, too, because it stood still.
            with pytest.raises(OutputError, match=r"stood still for more than 0\.5 s"), dead_for_others(tmp_path):
                raise failed
        with pytest.raises(OutputError, match="disk full"), Run(tmp_path):
            raise OutputError("disk full")
        other.send_signal(signal.SIGCONT)
        other.communicate()
    assert state(tmp_path) == []


@pytest.mark.usefixtures("_short_lease")
@pytest.mark.parametrize("skew", [pytest.param(-3600, marks=pytest.mark.proof), 3600])
def test_what_clocks_show_does_not_matter(tmp_path: Path, skew: int) -> None:
    with case.hold_frame(tmp_path, FRAME) as other, Run(tmp_path) as run:
        for file in (tmp_path / ".lookdev" / "runs").iterdir():
            skewed = file.stat().st_mtime + skew
            os.utime(file, (skewed, skewed))
        assert not run.claim(FRAME)
        other.send_signal(signal.SIGSTOP)
        case.wait_until(lambda: run.claim(FRAME))


def test_without_hard_links_claims_are_of_one_run_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_link(source: Path, target: Path) -> None:
        raise PermissionError(1, "Operation not permitted")

    with Run(tmp_path) as first, Run(tmp_path) as second:
        monkeypatch.setattr(os, "link", no_link)
        assert first.claim(FRAME)
        assert first.claim(FRAME)
        assert not second.claim(FRAME)
        first.release(FRAME)
        assert second.claim(FRAME)
    assert state(tmp_path) == []


def test_an_output_that_cannot_be_made_is_an_output_error(tmp_path: Path) -> None:
    (tmp_path / "out").touch()
    with pytest.raises(OutputError, match="out: the output folder cannot be written"), Run(tmp_path / "out"):
        raise AssertionError("a file cannot be an output folder")


def test_only_what_a_killed_run_left_is_removed(tmp_path: Path) -> None:
    folder, frames = tmp_path / ".lookdev", tmp_path / "gold"
    (folder / "scratch-abc" / "deeper").mkdir(parents=True)
    (folder / "scratch-abc" / "frame.npz").touch()
    frames.mkdir()
    with Run(tmp_path / "other") as other:
        process = other.info.id[:8]
    leftovers = [folder / ".pictures.0123abcd-0a1b2c3d.json"]
    leftovers += [frames / f".element.0001.{name}" for name in ("77-0a1b2c3d.exr", "0123abcd-0a1b2c3d.png")]
    intact = [folder / "pictures.json", frames / f".element.0001.{process}-0a1b2c3d.exr", frames / "element.0001.exr"]
    intact += [frames / name for name in (".element.0001.exr", ".notes.77-0a1b2c.txt", "element.77-0a1b2c3d.exr")]
    for path in leftovers + intact:
        path.touch()
    with Run(tmp_path) as run:
        assert not (folder / "scratch-abc").exists()
        run.remove_leftovers([folder, frames, tmp_path / "not_made_yet"])
    assert not any(path.exists() for path in leftovers)
    assert all(path.exists() for path in intact)


def test_a_run_that_joins_while_another_cleans_up_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    alive = Runs.alive
    joined: list[Run] = []
    with ExitStack() as stack, Run(tmp_path) as first:

        def alive_late(self: Runs) -> list[RunInfo]:
            living = alive(self)
            if not joined:
                # Another run joins just after the living runs were listed, and begins to write.
                joined.append(Run(tmp_path))
                stack.enter_context(joined[0])
                stack.enter_context(joined[0].scratch_folder())
            return living

        monkeypatch.setattr(Runs, "alive", alive_late)
        first._remove_scratch()
        (other,) = joined
        assert list((tmp_path / ".lookdev").glob(f"scratch-{other.info.id}-*"))
