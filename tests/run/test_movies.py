"""Movies of a batch: made when their frames are done, and made again only where they would differ."""

import subprocess
from pathlib import Path

import batch_case as case
import numpy as np
import pytest

from lookdev.errors import JobError

av = pytest.importorskip("av")

TIN = '[[look]]\nname = "tin"\nmaterial = "gold.usda"\n'
OUTPUTS = "sheet = false\nmovie = true\nprores = true\nvp9 = true\ngrid = true\n"
SUFFIXES = (".mp4", ".mov", ".webm")
KINDS = ("element", "lighting")
NAMES = sorted(
    [f"{look}/city/{kind}{suffix}" for look in ("gold", "tin") for kind in KINDS for suffix in SUFFIXES]
    + [f"city/{kind}.looks.mp4" for kind in KINDS]
)


def run(folder: Path, outputs: str = OUTPUTS) -> dict[str, bytes]:
    """Run a job of two looks, and return its movies."""
    case.run(folder, case.make_job(folder, case.TURNTABLES + TIN, case.RENDER + outputs))
    root = folder / "out"
    files = [path for path in root.rglob("*") if path.suffix in SUFFIXES]
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in sorted(files)}


def ages(folder: Path) -> dict[str, int]:
    return {name: (folder / "out" / name).stat().st_mtime_ns for name in NAMES}


def frame_count(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    """Return a folder that a run has finished, which is only read, and its movies."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, run(folder)


@pytest.fixture
def first(whole: tuple[Path, dict[str, bytes]], tmp_path: Path) -> dict[str, bytes]:
    """Return the movies of a finished run that has a copy in `tmp_path`."""
    subprocess.run(("cp", "-a", f"{whole[0]}/.", tmp_path), check=True)
    return whole[1]


def test_each_turntable_has_its_movies_and_all_looks_are_in_step(whole: tuple[Path, dict[str, bytes]]) -> None:
    folder, movies = whole
    assert sorted(movies) == NAMES
    for name in NAMES:
        assert frame_count(folder / "out" / name) == (4 if "element" in name else 3)
    with av.open(str(folder / "out" / "city" / "element.looks.mp4")) as container:
        width = container.streams.video[0].codec_context.width
    assert width > 2 * 128  # two cells side by side


def test_a_movie_is_made_again_only_if_it_would_differ(tmp_path: Path, first: dict[str, bytes]) -> None:
    written = ages(tmp_path)
    names = ("gold/city/.element.4711-0123abcd.mp4", "city/.element.looks.4711-0123abcd.mp4")
    leftovers = [tmp_path / "out" / name for name in names]
    for leftover in leftovers:
        leftover.write_bytes(b"half a movie, of a batch that was killed")
    assert run(tmp_path) == first
    assert ages(tmp_path) == written
    assert not any(leftover.exists() for leftover in leftovers)
    assert all(content != first[name] for name, content in run(tmp_path, OUTPUTS + "fps = 12.0\n").items())
    assert run(tmp_path, OUTPUTS + "movie_turns = 2\n").keys() == first.keys()
    assert frame_count(tmp_path / "out" / "gold" / "city" / "element.mov") == 8
    (tmp_path / "out" / "gold" / "city" / "element.0002.exr").unlink()
    assert run(tmp_path) == first  # the same pixels make the same bytes
    (tmp_path / "out" / "tin" / "city" / "lighting.mov").write_bytes(b"cut")
    written = ages(tmp_path)
    assert run(tmp_path) == first
    assert [name for name, age in ages(tmp_path).items() if age != written[name]] == ["tin/city/lighting.mov"]


# The first frame is in both turntables, the second in one.
@pytest.mark.parametrize("last", ["element_0001", pytest.param("lighting_0002", marks=pytest.mark.proof)])
def test_an_interrupted_batch_ends_with_the_same_movies(
    tmp_path: Path, whole: tuple[Path, dict[str, bytes]], last: str
) -> None:
    case.misbehave(tmp_path, **{last: ["failed", "failed", "failed", "failed", "ok"]})
    assert len(run(tmp_path)) < len(NAMES)
    assert run(tmp_path) == whole[1]


def test_a_movie_needs_pyav_and_options_need_a_movie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lookdev.job.outputs.find_spec", lambda name: None)
    with pytest.raises(JobError) as caught:
        case.make_job(tmp_path, render=case.RENDER + "movie = true\n")
    (fault,) = caught.value.faults
    assert (fault.where, fault.hint) == ("outputs.movie", "pip install 'lookdev[movie]'")
    assert "'av', which is not installed" in fault.what
    case.make_job(tmp_path, render=case.RENDER + "movie = false\n")
    monkeypatch.undo()
    case.make_job(tmp_path, render=case.RENDER + "grid = true\nfps = 25.0\n")
    with pytest.raises(JobError, match="'movie' or 'prores' or 'vp9' or 'grid'"):
        case.make_job(tmp_path, render=case.RENDER + "fps = 25.0\n")


def test_turns_double_no_frame_and_a_slate_precedes_them_once(tmp_path: Path) -> None:
    job = case.make_job(tmp_path, render=case.RENDER + "movie = true\nmovie_turns = 3\nslate = 0.5\n")
    # Each pose has another grey background, so that frames differ.
    case.run(tmp_path, job, render_background=lambda task: np.full(3, 0.1 + task.pose.element / 500.0))
    with av.open(str(tmp_path / "out" / "gold" / "city" / "element.mp4")) as container:
        frames = [np.frombuffer(bytes(frame.planes[0]), np.uint8) for frame in container.decode(video=0)]
    luma = [float(frame.reshape(6, -1)[:, :8].mean()) for frame in frames]
    assert len(luma) == 12 + 3 * 4
    # 0.25 plus half of the background, as luma from 16 to 235 in the Raw view.
    turn = [16.0 + 219.0 * (0.25 + 0.5 * (0.1 + angle / 500.0)) for angle in (0.0, 90.0, 180.0, 270.0)]
    assert luma[12:] == pytest.approx(turn * 3, abs=2.0)
    assert max(luma[:12]) < min(turn) - 10.0


def test_pictures_are_clean_unless_text_is_wanted(finished: Path) -> None:
    pictures = list((finished / "out" / "gold" / "city").glob("*.png"))
    clean = [path.read_bytes() for path in pictures]
    case.run(finished, case.make_job(finished, render=case.RENDER + 'burn_in = ["movie"]\n'))
    assert [path.read_bytes() for path in pictures] == clean
    for output in ("shet", "sheet"):
        with pytest.raises(JobError, match=f"no text can be burned into '{output}'"):
            case.make_job(finished, render=case.RENDER + f'burn_in = ["{output}"]\n')
