"""Large assets: what the files contain, at small sizes, and how starts are measured, with processes that do nothing."""

import json
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from bench_fakes import quiet

from lookdev.asset import load_asset
from lookdev.bench import scale
from lookdev.bench.options import BenchOptions
from lookdev.bench.scale import ScaleBenchmark, StartTimes, write_instances, write_meshes, write_quads
from lookdev.errors import RenderError
from lookdev.plan.prepare import prepare_job


@pytest.mark.parametrize(
    ("write", "sizes", "counts", "radius"),
    [
        (write_quads, (30,), (1, 1, {900}), pytest.approx(2.0**0.5, rel=0.01)),
        (write_instances, (4, 5), (1, 16, {25}), pytest.approx(1.25, abs=0.25)),
        (write_meshes, (205,), (205, 205, {6}), pytest.approx(1.25, abs=0.25)),
    ],
)
def test_a_file_has_the_size_that_is_asked_for(
    tmp_path: Path, write: Callable[..., object], sizes: tuple[int, ...], counts: tuple[object, ...], radius: object
) -> None:
    write(tmp_path / "asset.usdc", *sizes)
    asset = load_asset(tmp_path / "asset.usdc")
    assert (len(asset.meshes), len(asset.instances), {len(mesh.face_sizes) for mesh in asset.meshes}) == counts
    assert asset.radius == radius


TELLS = """
import json, sys
print(json.dumps({"reached": "planned"}), flush=True)
print(json.dumps({"reached": "sample", "memory": [3, 4]}), flush=True)
"""


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """Let a program stand for each process that is measured; return their arguments."""
    started: list[list[str]] = []
    real = scale.subprocess.Popen

    def popen(command: list[str], **options: object) -> object:
        if command[0] != sys.executable:
            return real(command, **options)  # one that the job's check starts
        started.append(command[2:])
        if command[-1].endswith("warm.toml"):
            assert len(prepare_job(Path(command[-1])).plan.frames) == 1  # the job that is measured can be rendered
        return real([sys.executable, "-c", TELLS if "broken" not in command[-1] else "raise SystemExit(3)"], **options)

    monkeypatch.setattr(scale.subprocess, "Popen", popen)
    return started


def benchmark(*cases: str, repeats: int = 1) -> ScaleBenchmark:
    files = {case: lambda file: write_quads(file, 2) for case in cases}
    return ScaleBenchmark(options=BenchOptions(repeats=repeats), report=quiet, cases=files)


def test_both_ways_alternate_after_one_start_to_warm_up(processes: list[list[str]], tmp_path: Path) -> None:
    results = benchmark("a", "b", repeats=2)
    results.run(tmp_path)
    ours, plain = "lookdev.bench.scale_job", "lookdev.cycles.plain_import"
    assert [(module, Path(request).name) for module, request in processes] == [
        (ours, "warm.toml"),
        *[(ours, "a.toml"), (plain, "a.json"), (ours, "b.toml"), (plain, "b.json")] * 2,
    ]
    assert [(start.case, start.program) for start in results.starts[:2]] == [("a", "lookdev"), ("a", "blender")]
    assert all(0.0 < start.planned <= start.sample and start.memory == (3, 4) for start in results.starts)
    assert len(json.loads((tmp_path / "scale.json").read_text())["starts"]) == 8


def test_a_process_that_fails_is_named(processes: list[list[str]], tmp_path: Path) -> None:
    with pytest.raises(RenderError, match="broken, lookdev: ended with exit code 3"):
        benchmark("broken").run(tmp_path)


def test_the_table_has_the_ratio_of_the_medians() -> None:
    results = benchmark()
    for sample in (1.0, 3.0, 8.0):
        results.starts.append(StartTimes("quads", "lookdev", 0.5, sample, (100_000_000, 200_000_000)))
        results.starts.append(StartTimes("quads", "blender", 0.5, 2.0 * sample, (600_000_000,)))
    text = results.summary()
    assert "x0.50" in text
    assert text.count("3.00") == 1
