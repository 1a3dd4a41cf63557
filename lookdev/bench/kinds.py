"""The registry of the benchmarks that `lookdev bench` can run."""

from __future__ import annotations

from lookdev.bench.benchmark import Benchmark
from lookdev.bench.denoise_trial import DenoiseTrial
from lookdev.bench.matrix import MatrixBenchmark, TableBenchmark
from lookdev.bench.profile import ProfileBenchmark
from lookdev.bench.scale import ScaleBenchmark
from lookdev.bench.sequence import SequenceBenchmark
from lookdev.bench.setup import SetupBenchmark

_KINDS = (
    MatrixBenchmark, TableBenchmark, ProfileBenchmark, SetupBenchmark, SequenceBenchmark, DenoiseTrial, ScaleBenchmark
)  # fmt: skip
KINDS: dict[str, type[Benchmark]] = {kind.NAME: kind for kind in _KINDS}
"""The classes of benchmarks by the names of their command-line options; without such an option the first one runs."""
