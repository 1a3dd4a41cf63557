"""Collection of the faults and notes about the files of a job, so that all of them are reported together."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from lookdev.errors import AssetError, CodegenError, EnvironmentMapError, Fault, FaultsError, ModelError, TextureError
from lookdev.job.schema import Job


class Findings:
    """The faults in the files of a job, and notes for the user."""

    def __init__(self, job: Job) -> None:
        self._file = str(job.file)
        self.faults: list[Fault] = []
        self.notes: list[str] = []

    def add(self, key: str, problem: str, hint: str = "") -> None:
        """Add a fault of a key in the job file."""
        self.faults.append(Fault(self._file, key, problem, hint))

    def note(self, *notes: str) -> None:
        """Add notes for the user."""
        self.notes += notes

    @contextmanager
    def collect(self, key: str) -> Iterator[None]:
        """Turn errors that are raised in the context into faults.

        A FaultsError has faults of its own. Any other error becomes a fault of `key`, a key in the job file.
        """
        try:
            yield
        except FaultsError as error:
            self.faults += error.faults
        except (AssetError, CodegenError, EnvironmentMapError, TextureError, ModelError) as error:
            self.add(key, str(error))

    def raise_faults(self) -> None:
        """Raise a FaultsError with all distinct faults, if there are any."""
        if unique := tuple(dict.fromkeys(self.faults)):
            raise FaultsError(unique)
