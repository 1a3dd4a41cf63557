from __future__ import annotations

import errno
import os
from pathlib import Path

import batch_case as case
import numpy as np
import pytest

from lookdev.batch.pictures import share, write_shared
from lookdev.batch.run import run_plan


def test_files_are_shared_as_links_or_as_copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (tmp_path / name for name in ("a", "b", "deep/c"))
    write_shared([first, second, third], lambda path: path.write_text("pixels") and None)
    assert first.samefile(second)
    assert first.samefile(third)

    def refuse(source: Path, target: Path) -> None:
        raise OSError(errno.EPERM, "no hard links here")

    monkeypatch.setattr(os, "link", refuse)
    second.write_text("old")
    os.utime(first, ns=(10**18, 10**18))
    copy = tmp_path / "copy"
    share(first, copy)
    assert not first.samefile(copy)
    assert copy.read_text() == first.read_text()
    assert copy.stat().st_mtime_ns == 10**18  # as a link would have it: pictures are compared by age


@pytest.mark.parametrize("spoilt", ["", "{", "[]"])
def test_a_spoilt_ledger_makes_every_picture_again(tmp_path: Path, spoilt: str) -> None:
    case.run(tmp_path)
    ledger = tmp_path / "out" / ".lookdev" / "pictures.json"
    whole = ledger.read_text()
    ledger.write_text(spoilt)
    case.run(tmp_path)
    assert len(case.requests(tmp_path)) == 6
    assert sorted(ledger.read_text().splitlines()) == sorted(whole.splitlines())


def test_large_frames_are_averaged_for_the_sheet(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[np.ndarray] = []
    monkeypatch.setattr("lookdev.batch.pictures.SHEET_SOURCE_SIZE", 4)
    monkeypatch.setattr("lookdev.batch.pictures.write_sheet", lambda path, frames, *rest: seen.extend(frames))
    job = case.make_job(tmp_path)
    behind = np.zeros((case.HEIGHT, case.WIDTH, 3))
    behind[:, ::2] = 1.0
    run_plan(job, case.make_plan(job), worker_command=case.command(tmp_path), background=lambda task: behind)
    assert len(seen) == 7
    assert seen[0].shape == (3, 4, 3)
    assert (seen[0] == 128).all()  # the mean of 0.25 and 0.25 + 0.5 * 1, in the Raw view
