"""The writers of movies of turntables, by PyAV: H.264 for browsers and players, ProRes 4444 and VP9 with alpha.

Pictures are converted to Y'CbCr of BT.709, limited range (ITU-R BT.709-6, items 3.2 to 3.4), in float32 and rounded
once. H.264 and VP9 here have chroma at half the resolution. A chroma sample is at the position that these codecs
assume: on the left of two columns, between two rows. A frame of odd size first gets a copy of its last column or row.
Encoders run with a fixed number of threads, and containers have no time and no random number, so that the same frames
give the same bytes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from functools import partial
from itertools import islice, repeat
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lookdev.arrays import Bytes, Floats32
from lookdev.cache import atomic_path
from lookdev.errors import OutputError
from lookdev.output.record import FrameSequence
from lookdev.output.sheet import OVERVIEW_CELLS, PAGE_ASPECT, SOURCE_SIZE, sheet_page
from lookdev.output.slate import draw_slate

_KR, _KB = 0.2126, 0.0722  # weights of red and blue in luma: BT.709-6, item 3.2
# The number of BT.709 in ITU-T H.273, for primaries, transfer and matrix; and FFmpeg's number of limited range.
_BT709, _LIMITED = 1, 1
_THREADS = 4  # threads of an encoder
_PAGE_WIDTH = 1920  # approximate width of a page of all looks side by side, in pixels


@dataclass(frozen=True)
class Codec:
    """The encoding of a movie.

    `encoder`, `container` and `pixels` are FFmpeg's names of the encoder, the container and the format of pixels.
    `options` and `container_options` are options of the encoder and of the container. `bits` is the number of bits of a
    sample. If the codec `halves_chroma`, chroma has half the resolution in both directions. If it has `alpha`, pictures
    have a fourth channel.
    """

    encoder: str
    container: str
    pixels: str
    bits: int
    halves_chroma: bool
    alpha: bool
    options: Mapping[str, str] = field(default_factory=dict)
    container_options: Mapping[str, str] = field(default_factory=dict)


_EXACT = {"fflags": "+bitexact"}  # no time and no random number in the container
_FAST = {**_EXACT, "movflags": "+faststart"}  # browsers play before they have the whole file
H264 = Codec("libx264", "mp4", "yuv420p", 8, True, False, {"crf": "8", "preset": "medium"}, _FAST)
PRORES = Codec("prores_ks", "mov", "yuva444p10le", 10, False, True, {"profile": "4444", "vendor": "apl0"}, _FAST)
# VP9 stores alpha as a second stream, which alternate reference frames would break.
_VP9 = {"crf": "12", "b": "0", "auto-alt-ref": "0", "cpu-used": "2"}
VP9 = Codec("libvpx-vp9", "webm", "yuva420p", 8, True, True, _VP9, _EXACT)


def _write_turntable(path: Path, frames: FrameSequence, codec: Codec) -> None:
    """Write the movie of a turntable: with alpha if the codec has it, otherwise over the frames' background."""
    _write_pictures(path, frames, frames.codes(alpha=codec.alpha), codec)


write_h264, write_prores, write_vp9 = (partial(_write_turntable, codec=codec) for codec in (H264, PRORES, VP9))


def write_grid(path: Path, frames: FrameSequence) -> None:
    """Write a movie of all looks side by side, with their names, as H.264.

    For each step in time, `frames` has a frame of each look, in the order of `frames.labels`.
    """
    _write_pictures(path, frames, _grid_pages(frames), H264)


def _write_pictures(path: Path, frames: FrameSequence, pictures: Iterable[Floats32], codec: Codec) -> None:
    """Write a movie of pictures that are made of frames, with the frames' options: rate, slate and repetitions."""
    rate, options = frame_rate(frames.options["fps"]), frames.options
    write_movie(path, _movie_pictures(frames, pictures, round(options["slate"] * rate)), codec, rate)


def _movie_pictures(frames: FrameSequence, pictures: Iterable[Floats32], slate_frames: int) -> Iterator[Floats32]:
    """Yield the slate `slate_frames` times, and then all pictures, repeated as the option ``movie_turns`` says."""
    turns = frames.options["movie_turns"]
    turn: list[Floats32] = []
    for number, picture in enumerate(pictures):
        if number == 0 and slate_frames:
            (height, width, channels), view = picture.shape, frames.options["view"]
            page = draw_slate(frames.files, frames.title, view, frames.options["fps"], (height, width), channels)
            yield from repeat(page, slate_frames)
        yield picture
        if turns > 1:
            turn.append(picture)
    for _ in range(turns - 1):
        yield from turn


def _grid_pages(frames: FrameSequence) -> Iterator[Floats32]:
    """Yield a page for each step in time, which has the pictures of all looks side by side."""
    looks = len(frames.labels)
    cells = frames.pictures(SOURCE_SIZE)
    max_cell = max(OVERVIEW_CELLS[1], _PAGE_WIDTH // math.ceil(math.sqrt(looks * PAGE_ASPECT)))
    while pictures := list(islice(cells, looks)):
        cell = min(max(OVERVIEW_CELLS[0], *(side for picture in pictures for side in picture.shape[:2])), max_cell)
        yield sheet_page(pictures, frames.labels, frames.title, cell=cell).astype(np.float32) / np.float32(255.0)


def frame_rate(fps: float) -> Fraction:
    """Return the exact rate of frames: 23.976, 29.97 and 59.94 mean 24, 30 and 60 times 1000/1001."""
    ntsc = Fraction(round(fps * 1.001) * 1000, 1001)
    return ntsc if abs(float(ntsc) - fps) < 0.005 and fps != round(fps) else Fraction(fps).limit_denominator(1000)


def write_movie(path: Path, pictures: Iterable[Floats32], codec: Codec, rate: Fraction) -> None:
    """Write a movie, complete or not at all.

    `pictures` are code values of a display in [0, 1], (H, W, 3), or (H, W, 4) with straight alpha where the codec has
    alpha. `rate` is in frames a second. Raises OutputError where the file cannot be written.
    """
    import av  # not at the top: it takes 0.1 s, and is an extra

    try:
        with (
            atomic_path(path) as temporary,
            av.open(str(temporary), "w", format=codec.container, options=dict(codec.container_options)) as container,
        ):
            stream = None
            for number, picture in enumerate(pictures):
                planes = to_planes(picture, codec)
                if stream is None:
                    stream = container.add_stream(codec.encoder, rate=rate, options=dict(codec.options))
                    stream.height, stream.width = planes[0].shape
                    stream.pix_fmt = codec.pixels
                    context = stream.codec_context
                    context.thread_count = _THREADS
                    context.color_primaries = context.color_trc = context.colorspace = _BT709
                    context.color_range = _LIMITED
                frame = av.VideoFrame(planes[0].shape[1], planes[0].shape[0], codec.pixels)
                frame.pts, frame.time_base = number, 1 / rate
                frame.colorspace, frame.color_range = _BT709, _LIMITED
                for plane, values in zip(frame.planes, planes, strict=True):
                    plane.update(_pad_rows(values, plane.line_size))
                container.mux(stream.encode(frame))
            if stream is not None:
                container.mux(stream.encode(None))
    except (OSError, av.error.FFmpegError) as error:
        raise OutputError(f"{path}: cannot write the movie: {error.strerror or error}") from error


def to_planes(picture: Floats32, codec: Codec) -> list[Bytes | NDArray[np.uint16]]:
    """Return the planes Y', Cb, Cr, and alpha where the codec has it, from code values (H, W, 3 or 4) in [0, 1]."""
    if codec.halves_chroma:
        height, width = picture.shape[:2]
        picture = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    red, green, blue = np.moveaxis(picture[..., :3], -1, 0)
    luma = np.float32(_KR) * red + np.float32(1.0 - _KR - _KB) * green + np.float32(_KB) * blue
    chroma = [(blue - luma) / np.float32(2.0 - 2.0 * _KB), (red - luma) / np.float32(2.0 - 2.0 * _KR)]
    if codec.halves_chroma:
        chroma = [_halve_chroma(plane) for plane in chroma]
    # Limited range: in 8 bits, Y' has 219 steps from 16, and Cb and Cr have 224 steps around 128 (item 3.4).
    unit = 2.0 ** (codec.bits - 8)
    planes = [(219.0 * luma + 16.0) * unit, *((224.0 * plane + 128.0) * unit for plane in chroma)]
    if codec.alpha:
        planes.append(picture[..., 3] * (2.0**codec.bits - 1.0))
    dtype = np.uint8 if codec.bits == 8 else np.uint16
    return [np.floor(plane + 0.5).astype(dtype) for plane in planes]


def _halve_chroma(chroma: Floats32) -> Floats32:
    """Return chroma (H, W) at half the resolution, for even H and W.

    A sample is the mean of two rows, and of every other column and its neighbours with weights 1, 2 and 1.
    """
    padded = np.pad(chroma, ((0, 0), (1, 0)), mode="edge")
    columns = (padded[:, :-1:2] + 2.0 * padded[:, 1::2] + padded[:, 2::2]) / 4.0
    halved: Floats32 = (columns[::2] + columns[1::2]) / 2.0
    return halved


def _pad_rows(plane: Bytes | NDArray[np.uint16], line_size: int) -> bytes:
    """Return the bytes of a plane, each row padded with zeros to `line_size` bytes."""
    rows = np.zeros((len(plane), line_size), np.uint8)
    data = plane.view(np.uint8).reshape(len(plane), -1)
    rows[:, : data.shape[1]] = data
    return rows.tobytes()
