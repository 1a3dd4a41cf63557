"""The names of frames in the output folder of a job, and the files of frames there."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

FRAME_PATTERN = "<look>/<rig>/<turntable>.####"
"""The pattern of a frame's name in documentation and messages."""

_FILE_NAME = re.compile(r"(?P<turntable>[^.].*)\.(?P<number>\d{4,})\.exr")


@dataclass(frozen=True)
class FrameName:
    """The name of a frame, ``<look>/<rig>/<turntable>.####``; numbers begin with 1."""

    look: str
    rig: str
    turntable: str
    number: int

    def __str__(self) -> str:
        return f"{self.look}/{self.rig}/{self.turntable}.{self.digits}"

    @property
    def digits(self) -> str:
        """The number with at least four digits, as in the name."""
        return f"{self.number:04d}"

    @property
    def reel(self) -> tuple[str, str, str]:
        """Look, rig and turntable; the frames that share these three are a reel."""
        return self.look, self.rig, self.turntable

    def file(self, output: Path) -> Path:
        """Return the path of the frame's EXR in an output folder."""
        return output / f"{self}.exr"

    @classmethod
    def of(cls, file: Path) -> Self:
        """Return the name of the frame with this EXR; raises ValueError where the path is not a frame's."""
        name = _FILE_NAME.fullmatch(file.name)
        if name is None or len(file.parts) < 3:
            raise ValueError(f"{file} is not a frame, {FRAME_PATTERN}.exr")
        look, rig = file.parts[-3:-1]
        return cls(look, rig, name["turntable"], int(name["number"]))


def frame_files(output: Path) -> Iterator[tuple[FrameName, Path]]:
    """Yield the name and the path of the EXR of each frame in an output folder, sorted by path."""
    for file in sorted(output.glob("*/*/*.exr")):
        if _FILE_NAME.fullmatch(file.name):
            yield FrameName.of(file), file
