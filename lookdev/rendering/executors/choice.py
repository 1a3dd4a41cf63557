"""The kinds of executors, and the choice of an executor by options of the command line.

An executor renders the frames of a run on workers: on workers of this machine, on workers of a Dask cluster, or on a
warm worker, which stays alive between runs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from lookdev.errors import LookdevError, nearest_hint
from lookdev.rendering.backends import BACKENDS
from lookdev.rendering.executors.local import LocalExecutor
from lookdev.rendering.executors.protocol import Executor, StoreFrame, WorkerFiles


@dataclass(frozen=True)
class ExecutorOptions:
    """The options of the command line that determine the executor.

    Attributes
    ----------
    kind
        The name of the kind of executor, a key of `EXECUTORS`.
    address
        The address of the executor; "" if it has none.
    workers
        The number of workers. With None, the executor chooses the number.
    device
        The kind of device, such as ``"cuda"``. It replaces the device of the job, unless it is None.
    device_numbers
        The numbers of the devices of that kind to use, as the vendor's tools count them; () means all.
    shared_output
        Whether workers themselves write the files of frames, to a file system that they share with this machine.
    """

    kind: str = "local"
    address: str = ""
    workers: int | None = None
    device: str | None = None
    device_numbers: tuple[int, ...] = ()
    shared_output: bool = False

    @property
    def is_local(self) -> bool:
        """Whether the executor has no address and starts workers on this machine.

        At an address, workers run already, with devices of their own.
        """
        return not self.address


LOCAL_OPTIONS = ExecutorOptions()


@dataclass(frozen=True)
class ExecutorKind:
    """A kind of executor, and the options that it has."""

    help: str
    address: str  # an example of an executor's address, for messages; "" if such executors have no address
    open: Callable[[ExecutorOptions, WorkerFiles, StoreFrame], Executor]
    needs_address: bool = False
    has_worker_count: bool = False  # whether the user sets the number of its workers
    can_store: bool = False  # whether its workers can write the files of frames


# The environment variable that restricts a process to some devices of this machine, by the kind of device.
_VISIBLE_DEVICES = {
    "cuda": "CUDA_VISIBLE_DEVICES",
    "optix": "CUDA_VISIBLE_DEVICES",
    "hip": "HIP_VISIBLE_DEVICES",
    "oneapi": "ONEAPI_DEVICE_SELECTOR",
}


def _open_local(choice: ExecutorOptions, files: WorkerFiles, store: StoreFrame) -> Executor:
    return LocalExecutor(files, choice.workers, device_environments(choice))


def _open_dask(choice: ExecutorOptions, files: WorkerFiles, store: StoreFrame) -> Executor:
    from lookdev.rendering.executors.dask import DaskExecutor

    if choice.address and choice.workers is not None:
        raise LookdevError("--workers: the scheduler of Dask has workers of its own; leave it out")
    return DaskExecutor(files, choice.address, choice.workers, store if choice.shared_output else None)


def _open_warm(choice: ExecutorOptions, files: WorkerFiles, store: StoreFrame) -> Executor:
    from lookdev.rendering.executors.warm import WarmExecutor

    return WarmExecutor(files, Path(choice.address))


EXECUTORS: dict[str, ExecutorKind] = {
    "local": ExecutorKind("workers of this machine", "", _open_local, has_worker_count=True),
    "dask": ExecutorKind(
        "workers of Dask, on a cluster that is started here, or on that of a scheduler",
        "tcp://HOST:8786",
        _open_dask,
        has_worker_count=True,
        can_store=True,
    ),
    "warm": ExecutorKind(
        "the worker that 'lookdev warm start' keeps at a socket", "SOCKET", _open_warm, needs_address=True
    ),
}


def open_executor(choice: ExecutorOptions, files: WorkerFiles, store: StoreFrame) -> Executor:
    """Return the executor that the options choose. It is a context manager.

    `store` writes the file of a frame. Raises LookdevError where the executor does not support one of the options.
    """
    return EXECUTORS[choice.kind].open(choice, files, store)


def choose_executor(executor: str, *, workers: int | None, device: str | None, shared_output: bool) -> ExecutorOptions:
    """Parse and check the options of the command line.

    executor : an executor, such as ``dask:tcp://host:8786``; device : a device, such as ``cuda:0,1``. Raises
    LookdevError where an option is wrong, or does not fit the executor.
    """
    kind, _, address = executor.partition(":")
    record = EXECUTORS.get(kind)
    if record is None:
        raise LookdevError(f"--executor: unknown executor '{kind}' ({nearest_hint(kind, list(EXECUTORS))})")
    if address and not record.address:
        raise LookdevError(f"--executor: '{kind}' has no address: write --executor {kind}")
    if record.needs_address and not address:
        raise LookdevError(f"--executor: '{kind}' needs an address: write --executor {kind}:{record.address}")
    if workers is not None and not record.has_worker_count:
        raise LookdevError(f"--workers: executor '{kind}' has workers of its own")
    if shared_output and not record.can_store:
        raise LookdevError(
            f"--shared: workers of executor '{kind}' are on this machine, whose output they need not share"
        )
    name, numbers = _parse_device(device) if device is not None else (None, ())
    if numbers and kind != "local":
        raise LookdevError(f"--device: executor '{kind}' has devices of its own: write --device {name}")
    return ExecutorOptions(kind, address, workers, name, numbers, shared_output)


def _parse_device(text: str) -> tuple[str, tuple[int, ...]]:
    """Return the kind of device, and the numbers of the devices, that an option such as ``cuda:0,1`` names."""
    kind, _, numbers = text.partition(":")
    kinds = list(dict.fromkeys(device for backend in BACKENDS.values() for device in backend.devices))
    if kind not in kinds:
        raise LookdevError(f"--device: unknown device '{kind}' ({nearest_hint(kind, kinds)})")
    if not numbers and text == kind:
        return kind, ()
    if kind not in _VISIBLE_DEVICES:
        raise LookdevError(f"--device: devices of kind '{kind}' cannot be chosen by number: write --device {kind}")
    if not re.fullmatch(r"\d{1,3}(,\d{1,3})*", numbers):
        raise LookdevError(f"--device: '{text}' should be as {kind}:0 or {kind}:0,1")
    return kind, tuple(dict.fromkeys(map(int, numbers.split(","))))


def device_environments(choice: ExecutorOptions) -> tuple[Mapping[str, str], ...]:
    """Return sets of environment variables that restrict workers to the chosen devices.

    Worker i takes set i modulo the number of sets. If there are several workers, each set names one device. For a
    single worker, there is one set, which names all chosen devices.
    """
    if choice.device is None or not choice.device_numbers:
        return ({},)
    variable, prefix = _VISIBLE_DEVICES[choice.device], "level_zero:" if choice.device == "oneapi" else ""
    names = [f"{prefix}{number}" for number in choice.device_numbers]
    if choice.workers is None or choice.workers == 1:
        return ({variable: prefix + ",".join(map(str, choice.device_numbers))},)
    return tuple({variable: name} for name in names)
