"""Movies, probed and decoded by PyAV, and played by Chromium."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from chromium import Page, serve_files
from scipy.ndimage import maximum_filter, minimum_filter

from lookdev.errors import OutputError
from lookdev.output.display import to_display
from lookdev.output.movie import H264, PRORES, VP9, Codec, frame_rate, to_planes, write_movie

av = pytest.importorskip("av")

CODECS = {"h264": (H264, ".mp4"), "prores": (PRORES, ".mov"), "vp9": (VP9, ".webm")}
COUNT = 12
PLAIN = Codec("", "", "", 8, False, False)


def turntable(width: int = 96, height: int = 64, count: int = COUNT) -> list[np.ndarray]:
    """Code values and alpha of a lit, coloured ball whose bright side goes around, over a ramp."""
    y, x = np.mgrid[:height, :width]
    u, v = 2.2 * x / width - 1.1, (2.2 * y - 1.1 * height) / width
    inside = np.clip((0.9 - np.hypot(u, v)) * width / 4, 0.0, 1.0)
    pictures = []
    for number in range(count):
        angle = 2.0 * np.pi * number / count
        light = np.clip(0.5 + 0.5 * (u * np.cos(angle) + v * np.sin(angle)), 0.0, 1.0)[..., None]
        rgb = light * (0.9, 0.45, 0.15) * inside[..., None] + 0.2 * (1 - inside[..., None])
        pictures.append(np.concatenate([rgb, inside[..., None]], axis=-1).astype(np.float32))
    return pictures


def away_from_edges(alpha: np.ndarray) -> np.ndarray:
    """Return where no pixel of another alpha is so near that halved chroma mixes the colours of both."""
    return minimum_filter(alpha, 9) == maximum_filter(alpha, 9)


def cells(picture: np.ndarray) -> np.ndarray:
    """Return the means of 8 x 8 pixels."""
    return picture.reshape(8, 8, 12, 8, 3).mean(axis=(1, 3))


def decode(path: Path, decoder: str | None = None) -> list[list[np.ndarray]]:
    """Return the planes of each frame, as integers of their number of bits."""
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        context = av.CodecContext.create(decoder, "r") if decoder else None
        frames = []
        for packet in container.demux(stream):
            frames += [frame_planes(frame) for frame in (context.decode(packet) if context else packet.decode())]
    return frames


def frame_planes(frame: object) -> list[np.ndarray]:
    dtype = np.uint16 if "10" in frame.format.name or "12" in frame.format.name else np.uint8
    arrays = []
    for plane in frame.planes:
        rows = np.frombuffer(bytes(plane), np.uint8).reshape(plane.height, plane.line_size)
        arrays.append(np.ascontiguousarray(rows[:, : plane.width * dtype().itemsize]).view(dtype))
    return arrays


def as_rgb(planes: list[np.ndarray], bits: int) -> np.ndarray:
    """R'G'B' of BT.709 in [0, 255] (H, W, 3); halved chroma is repeated. The inverse matrix, written out."""
    unit = 2.0 ** (bits - 8)
    luma = (planes[0] / unit - 16.0) / 219.0
    cb, cr = ((plane / unit - 128.0) / 224.0 for plane in planes[1:3])
    if cb.shape != luma.shape:
        cb, cr = (plane.repeat(2, axis=0).repeat(2, axis=1) for plane in (cb, cr))
    green = luma - 0.1873242729 * cb - 0.4681242729 * cr
    return 255.0 * np.stack([luma + 1.5748 * cr, green, luma + 1.8556 * cb], axis=-1)


@pytest.mark.both_pythons
@pytest.mark.parametrize("name", CODECS)
def test_a_movie_has_the_frames_rate_size_and_tags(tmp_path: Path, name: str) -> None:
    codec, suffix = CODECS[name]
    path, again = (tmp_path / f"{stem}{suffix}" for stem in "ab")
    for file in (path, again):
        write_movie(file, iter(turntable()), codec, Fraction(24000, 1001))
    assert path.read_bytes() == again.read_bytes()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        context = stream.codec_context
        assert (context.width, context.height) == (96, 64)
        assert float(stream.average_rate) == pytest.approx(24000 / 1001, rel=1e-4)  # WebM counts milliseconds
        assert (context.color_primaries, context.color_trc, context.colorspace) == (1, 1, 1)  # BT.709, by ITU-T H.273
        # Limited. QuickTime's tags of ProRes have no range, which FFmpeg before 8 does not infer.
        assert context.color_range == 1 or (name == "prores" and context.color_range == 0)
        assert context.name == name
        assert sum(1 for _ in container.decode(stream)) == COUNT
        assert container.duration / 1e6 == pytest.approx(COUNT * 1001 / 24000, abs=0.05)
    assert {*tmp_path.iterdir()} == {path, again}


@pytest.mark.parametrize("name", CODECS)
def test_the_first_frame_is_that_of_the_png(tmp_path: Path, name: str) -> None:
    codec, suffix = CODECS[name]
    path, pictures = tmp_path / f"a{suffix}", turntable()
    write_movie(path, pictures, codec, Fraction(24))
    first, *_ = decode(path, "libvpx-vp9" if name == "vp9" else None)
    bits = 12 if name == "prores" and first[0].max() > 1023 else codec.bits
    seen, png = as_rgb(first, bits), to_display(pictures[0][..., :3], "Raw").astype(float)
    # Rounding Y'CbCr to 8 bits alone moves a pixel by up to .5 (255 / 219 + 1.8556 * 255 / 224) = 1.6 in blue, and
    # chroma halved by up to 2.7 in this picture; the encoder's noise has no mean.
    difference = (seen - png) * away_from_edges(pictures[0][..., 3])[..., None]
    assert np.abs(cells(difference)).max() <= 2.0
    assert np.percentile(np.abs(difference), 99) <= 3.0
    assert np.abs(difference).max() <= 8.0
    if codec.alpha:
        alpha = first[3] / (2.0**bits - 1.0)
        assert np.abs(alpha - pictures[0][..., 3]).max() <= (8.0 if name == "vp9" else 2.0) / 255.0


@pytest.mark.parametrize("bits", [8, 10])
def test_planes_are_those_of_bt709(bits: int) -> None:
    codec = Codec("", "", "", bits, False, False)
    colors = np.array([[[0, 0, 0], [1, 1, 1], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0.5]]], np.float32)
    luma, cb, cr = (plane[0].tolist() for plane in to_planes(colors, codec))
    if bits == 8:  # BT.709 bars at 100 %, as test generators have them
        bars = [16, 235, 63, 173, 32], [128, 128, 102, 42, 240], [128, 128, 240, 26, 118]
        assert (luma[:5], cb[:5], cr[:5]) == bars
    else:
        assert (luma[0], luma[1], cb[4], cr[2]) == (64, 940, 960, 960)


def test_halved_chroma_is_sited_on_the_left_column() -> None:
    # Chroma that rises linearly in x: a sample on a column has that column's value.
    ramp = np.linspace(0.2, 0.8, 16, dtype=np.float32)
    picture = np.stack([np.full_like(ramp, 0.5), np.full_like(ramp, 0.5), ramp], axis=-1)[None].repeat(4, axis=0)
    half, full = (to_planes(picture, Codec("", "", "", 10, halved, False))[1] for halved in (True, False))
    assert half.shape == (2, 8)
    assert np.abs(half[:, 1:].astype(int) - full[::2, 2::2]).max() <= 1


@pytest.mark.parametrize("name", CODECS)
def test_odd_sizes_are_padded(tmp_path: Path, name: str) -> None:
    codec, suffix = CODECS[name]
    pictures = turntable(33, 21, 2)
    write_movie(tmp_path / f"a{suffix}", pictures, codec, Fraction(24))
    assert decode(tmp_path / f"a{suffix}")[0][0].shape == ((22, 34) if codec.halves_chroma else (21, 33))
    if codec.halves_chroma:
        luma = to_planes(pictures[0], codec)[0]
        assert (luma[:, -1] == luma[:, -2]).all()


def test_a_movie_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="cannot write the movie"):
        write_movie(tmp_path / "file" / "a.mp4", turntable(count=1), H264, Fraction(24))

    def interrupted() -> object:
        yield turntable(count=1)[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_movie(tmp_path / "a.mp4", interrupted(), H264, Fraction(24))
    assert [file.name for file in tmp_path.iterdir()] == ["file"]


def test_rates_are_exact() -> None:
    rates = {24.0: Fraction(24), 23.976: Fraction(24000, 1001), 29.97: Fraction(30000, 1001), 12.5: Fraction(25, 2)}
    assert {fps: frame_rate(fps) for fps in rates} == rates


PLAY = """
const canvas = document.createElement("canvas"), ink = canvas.getContext("2d", {willReadFrequently: true});
const video = document.createElement("video");
video.muted = true;
document.body.append(video);
const on = (event) => new Promise((done, fail) => {
  video.addEventListener(event, done, {once: true});
  video.addEventListener("error", () => fail(video.error && video.error.message), {once: true});
});
// `loadeddata` may come before the first picture can be drawn: this waits until it is on the page.
const shown = new Promise((done) => video.requestVideoFrameCallback((now, frame) => done(frame.mediaTime)));
const loaded = on("loadeddata");
video.src = given[0];
await loaded;
const time = await shown;
[canvas.width, canvas.height] = [video.videoWidth, video.videoHeight];
ink.drawImage(video, 0, 0);
const first = [...ink.getImageData(0, 0, canvas.width, canvas.height).data], ended = on("ended");
await video.play();
await ended;
return {size: [video.videoWidth, video.videoHeight], duration: video.duration, time, first};
"""


def test_chromium_plays_what_the_png_shows(tmp_path: Path, tab: Any) -> None:
    pictures = turntable()
    write_movie(tmp_path / "a.mp4", pictures, H264, Fraction(24))
    write_movie(tmp_path / "a.webm", pictures, VP9, Fraction(24))
    (tmp_path / "page.html").write_text("<!doctype html><title>movies</title>")
    with serve_files(tmp_path) as url:
        page = Page(tab, f"{url}/page.html", (800, 600), "document.body")
        answers = {name: page.js(PLAY, name) for name in ("a.mp4", "a.webm")}
    png = to_display(pictures[0][..., :3], "Raw").astype(float)
    inside = away_from_edges(pictures[0][..., 3]) & (pictures[0][..., 3] == 1.0)
    for name, answer in answers.items():
        assert answer["size"] == [96, 64]
        assert answer["time"] == 0.0
        assert answer["duration"] == pytest.approx(COUNT / 24, abs=0.05)
        pixels = np.array(answer["first"], float).reshape(64, 96, 4)
        difference = (pixels[..., :3] - png) * inside[..., None]
        # With alpha Chromium converts by libyuv, whose factor of blue is 2 instead of 2.112: it has 8 bits.
        clipped = 0.112 * np.abs(to_planes(pictures[0], PLAIN)[1] - 128.0) * inside * (name == "a.webm")
        excess = np.abs(cells(difference)) - cells(clipped[..., None] * (0.0, 0.0, 1.0)) - 2.0
        assert excess.max() <= 0.0, (name, excess.max(), np.argwhere(excess > 0.0)[:8], pixels.mean(axis=(0, 1)))
        if name == "a.webm":
            assert np.abs(pixels[..., 3] / 255.0 - pictures[0][..., 3]).max() <= 8.0 / 255.0
