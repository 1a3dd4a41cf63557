"""How well a job is divided among many workers, simulated by measured costs."""

import farm
import pytest

from lookdev.plan.chunks import Division


@pytest.fixture(scope="module")
def job() -> farm.SimulatedJob:
    """Ten looks under four rigs, two turntables of 72 frames that share one, 5 s a frame."""
    return farm.measured_job(looks=10, rigs=4, frames=143, mean=5.0)


def test_one_worker_takes_the_time_of_all(job: farm.SimulatedJob) -> None:
    divisions = [Division(1), Division(7), Division(7, 2)]
    times = [farm.chunked(job, job.means, 1, division, warm=True) for division in divisions] + [farm.shared(job, 1)]
    again = 6 * job.planning
    assert times == pytest.approx([job.alone, job.alone + again, job.alone + again, job.alone])


@pytest.mark.parametrize("workers", [8, 64])
def test_chunks_by_estimates_that_fall_are_efficient(job: farm.SimulatedJob, workers: int) -> None:
    seconds = farm.chunked(job, job.estimates, workers, Division(6 * workers, workers), warm=True)
    assert 0.95 <= farm.efficiency(job, workers, seconds) <= 1.0


@pytest.mark.parametrize("workers", [4, 16, 64])
def test_chunks_by_measured_times_are_efficient(job: farm.SimulatedJob, workers: int) -> None:
    seconds = farm.chunked(job, job.means, workers, Division(workers), warm=False)
    assert 0.95 <= farm.efficiency(job, workers, seconds) <= 1.0


@pytest.mark.parametrize("seed", range(3))
def test_runs_that_share_frames_are_efficient(job: farm.SimulatedJob, seed: int) -> None:
    assert 0.95 <= farm.efficiency(job, 64, farm.shared(job, 64, seed)) <= 1.0


def test_measured_times_divide_better_than_estimates_and_these_better_than_none(job: farm.SimulatedJob) -> None:
    even = [5.0] * len(job.frames)
    times = [farm.chunked(job, costs, 64, Division(64), warm=False) for costs in (job.means, job.estimates, even)]
    assert times == sorted(times)
