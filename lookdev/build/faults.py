"""Faults of the files that a job names, collected so that all are reported together."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from lookdev.errors import AssetError, CodegenError, EnvironmentMapError, Fault, FaultsError, ModelError, TextureError
from lookdev.job.schema import Job


@contextmanager
def collected(job: Job, where: str, faults: list[Fault]) -> Iterator[None]:
    """Add errors of a file of the job to `faults`, with the key that names the file."""
    try:
        yield
    except FaultsError as error:
        faults += error.faults
    except (AssetError, CodegenError, EnvironmentMapError, TextureError, ModelError) as error:
        faults.append(Fault(str(job.file), where, str(error)))


def raise_all(faults: Iterable[Fault]) -> None:
    """Raise a FaultsError of all faults, each once, if there are any."""
    if unique := tuple(dict.fromkeys(faults)):
        raise FaultsError(unique)
