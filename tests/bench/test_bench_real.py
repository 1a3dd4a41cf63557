"""The benchmark itself, at a size at which its figures mean nothing: `pytest -m bench`."""

from pathlib import Path

import numpy as np
import pytest
from bench_fakes import quiet

from lookdev.bench import growth, sequence
from lookdev.bench.benchmark import SECTION_END, section_marker
from lookdev.bench.matrix import MatrixBenchmark, TableBenchmark, open_candidates
from lookdev.bench.measure import PICTURES, Series
from lookdev.bench.options import BenchOptions, Cell, parse_options
from lookdev.bench.profile import ProfileBenchmark
from lookdev.bench.scale import ScaleBenchmark, write_instances, write_meshes, write_quads
from lookdev.bench.sequence import SequenceBenchmark, SequenceSubject, producers_of
from lookdev.output.exr import read_frame

# Not `cycles` too: what measures time is in no other selection.
pytestmark = pytest.mark.bench

BACKENDS = ("exact", "principled", "mitsuba-principled")


def test_a_small_matrix(tmp_path: Path) -> None:
    lists = {"scenes": "sphere,suzanne", "ibls": "city", "looks": "plastic,pixar", "samples": "4,16"}
    lists["backends"] = ",".join(BACKENDS)
    options = parse_options(lists, resolution=48, repeats=2, reference=4)
    results = MatrixBenchmark(options=options, report=quiet)
    results.run(tmp_path / "first")
    assert results.complete
    for cell in results.cells:
        assert tuple(map(str, cell.curves)) == options.backends_of(cell.cell)
        for curve in cell.curves.values():
            few, many = curve
            assert few.relmse is not None
            assert many.relmse is not None
            assert many.relmse < few.relmse
            assert few.seconds > 0.0
            assert abs(many.bias) < 6.0 * many.bias_error
        assert all(row.memory > 1e8 for row in cell.measurements)
        assert {row.renderer.split()[0] for row in cell.measurements if "mitsuba" in row.backend} <= {"mitsuba"}
    again: list[str] = []
    MatrixBenchmark(options=options, report=again.append).run(tmp_path / "second")
    assert not [text for text in again if "reference" in text]


def test_all_backends_show_the_same_scene() -> None:
    options = BenchOptions(backends=BACKENDS, resolution=64)
    with open_candidates(Cell("suzanne", "city", "metal"), options) as candidates:
        shots = {candidate.backend: candidate.render(64, 1) for candidate in candidates}
    exact = shots.pop("exact")
    for shot in shots.values():
        # 64 samples place an edge to about 1 / 8 of a pixel.
        assert np.abs(shot.alpha - exact.alpha).max() < 0.35
        assert np.corrcoef(shot.image.ravel(), exact.image.ravel())[0, 1] > 0.9


def test_the_plain_script_shows_what_the_batch_runner_does(tmp_path: Path) -> None:
    producers = producers_of(SequenceSubject("suzanne", "plastic", ("city",), 64))
    for name, produce in producers.items():
        assert produce(tmp_path / name, 64, 3, 1)[0] > 0.0
    for kind in sequence.KINDS:
        for number in (1, 2, 3):
            path = Path("plastic", "city", f"{kind}.{number:04d}.exr")
            (exact, alpha), (plain, coverage) = (read_frame(tmp_path / name / path) for name in ("exact", "plain"))
            # The models differ a little; a wrong angle of asset or light leaves some 0.9.
            assert np.corrcoef(exact.ravel(), plain.ravel())[0, 1] > 0.98
            assert np.abs(alpha - coverage).max() < 0.35


def test_a_small_sequence(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sequence, "FRAMES", 3)
    monkeypatch.setattr(sequence, "TARGET", 2e-2)
    options = BenchOptions(scenes=("suzanne",), ibls=("city",), samples=(4, 16), resolution=48, repeats=1)
    benchmark = SequenceBenchmark(options=options, report=quiet)
    benchmark.run(tmp_path)
    assert benchmark.complete
    assert benchmark.result is not None
    assert benchmark.result.ratio > 0.0


def test_a_small_table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    sizes = {"PIXELS": (32, 64), "LOOK_COUNTS": (1, 3), "LIGHTS": (1, 5), "LAYERS": (4,), "TRIANGLES": (1000,)}
    for name, value in (sizes | {"_REPEATS": 1}).items():
        monkeypatch.setattr(growth, name, value)
    document = tmp_path / "bench.md"
    document.write_text(f"{section_marker('table')}\n{SECTION_END}\n")
    lists = {"scenes": "shaderball", "looks": "copper", "ibls": "city", "samples": "4,16"}
    options = parse_options(lists, defaults=TableBenchmark.DEFAULTS, resolution=48, repeats=2, frames=4)
    results = TableBenchmark(options=options, report=quiet)
    results.run(tmp_path, document)
    assert results.complete
    assert results.failures == []
    assert {result.quantity for result in results.growth} == set(growth.QUANTITIES)
    (cell,) = results.cells
    here = [name for name in options.backends if name not in results.missing]
    assert list(cell.curves) == [Series(name, way) for name in here for way in PICTURES]
    for series, curve in cell.curves.items():
        raw = cell.curves[Series(series.backend)]
        assert all(point.seconds > of_raw.seconds for point, of_raw in zip(curve, raw, strict=True)) == (
            series.picture_kind == "denoised"
        )
    # Recesses of copper are noisy: 16 samples leave more than a denoiser's bias, with every renderer's guides.
    for name in here:
        noisy, smooth = (cell.curves[Series(name, way)][0].relmse for way in PICTURES)
        assert noisy is not None
        assert smooth is not None
        assert smooth < noisy
    assert (tmp_path / "bench_copper.svg").exists()


def test_a_small_profile(tmp_path: Path) -> None:
    document = tmp_path / "bench.md"
    document.write_text(f"{section_marker('profile')}\n{SECTION_END}\n")
    lists = {"scenes": "sphere", "looks": "plastic", "samples": "16"}
    options = parse_options(lists, defaults=ProfileBenchmark.DEFAULTS, resolution=32, repeats=2)
    profile = ProfileBenchmark(options=options, report=quiet)
    profile.run(tmp_path, document)
    assert profile.failures == []
    (cell,) = profile.cells
    # Medians of two are their mean.
    assert sum(middle for middle, _, _ in cell.parts.values()) == pytest.approx(1.0)


def test_a_small_scale(tmp_path: Path) -> None:
    cases = {
        "quads": lambda file: write_quads(file, 20),
        "instances": lambda file: write_instances(file, 3, 4),
        "meshes": lambda file: write_meshes(file, 100),
    }
    results = ScaleBenchmark(options=BenchOptions(repeats=1), report=quiet, cases=cases)
    results.run(tmp_path)
    assert len(results.starts) == 6
    for start in results.starts:
        assert 0.1 < start.planned < start.sample
        assert len(start.memory) == (2 if start.program == "lookdev" else 1)
        assert min(start.memory) > 1e8
