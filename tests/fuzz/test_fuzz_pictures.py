"""Malformed inputs that are read show the picture of a sound input; so does a job whose cache is damaged."""

import random
import shutil
import tempfile
from pathlib import Path

import numpy as np
import pytest
from cases import judge, make_case
from damaged_files import PRODUCTS, WAYS
from image_files import RGB, exr
from kinds import KINDS
from looks import quick_among
from pictures import CLOSE, Painter, difference, job, table
from usd_sound import SOUND

from lookdev.arrays import Floats32
from lookdev.asset.usd import read_usd
from lookdev.job import load_job
from lookdev.plan.prepare import plan_job
from lookdev.rendering.results import WorkerFrame
from lookdev.rendering.task import FrameTask
from lookdev.rendering.worker import Worker, open_renderer
from lookdev.stage import Composition, compose

pytestmark = pytest.mark.cycles

# A malformed environment has tables of its own, of three seconds; a texture is an image that is read by the same code.
_QUICK = [("USD assets", 0, 2, "exact")]
_QUICK += [(kind, 0, 1, "exact") for kind in ("names", "looks", "MaterialX", "textures")]
_MANY = [("USD assets", 1, 90), ("USD assets", 2, 90), ("MaterialX", 1, 60), ("names", 1, 80)]
_MANY += [("looks", 1, 12), ("environments", 1, 40), ("textures", 1, 24)]
_IN_NODES = [(kind, 3, 10 if kind == "USD assets" else 5, "nodes") for kind, seed, _ in _MANY if seed == 1]
_PICTURES = [*_QUICK, *((*many, "exact") for many in _MANY), *_IN_NODES]


@pytest.fixture
def paint(cycles_worker: Worker) -> Painter:
    def render(task: FrameTask) -> WorkerFrame:
        cycles_worker.start()
        return cycles_worker.render(task, lambda progress: None)

    return Painter(render)


@pytest.mark.parametrize(("kind", "seed", "count", "backend"), quick_among(_PICTURES, _QUICK))
def test_malformed_inputs_show_the_right_picture(
    paint: Painter, kind: str, seed: int, count: int, backend: str
) -> None:
    """Compare pictures of cases that are read, until there are `count`."""
    numbers = list(range(KINDS[kind].count))
    random.Random(f"{kind} {seed}").shuffle(numbers)
    shown, wrong = 0, []
    for number in numbers:
        with tempfile.TemporaryDirectory() as folder:
            case = make_case(KINDS[kind], seed, number, Path(folder))
            # Where another meaning is right, so is another picture.
            if case.shown is None or "silent" in case.expected or not case.expected & {"sound", "noted"}:
                continue
            outcome = judge(case)
            assert outcome.right, f"{case.title}: {outcome.outcome}: {outcome.text}"
            if outcome.outcome == "refused":
                continue
            compared = paint.compared(case, Path(folder), outcome, backend)
        shown += compared.shown
        if not compared.like:
            wrong.append(f'{case.title}: {compared.text}\npython tests/fuzz/rerun.py "{kind}" {seed} {number}')
        if shown == count:
            break
    assert not wrong
    assert shown == count


@pytest.mark.proof
@pytest.mark.parametrize("base", ["mesh", "cage", "curves", "points", "instancer", "Capsule"])
def test_an_asset_shows_the_same_picture_at_the_limits_of_size(paint: Painter, tmp_path: Path, base: str) -> None:
    text = SOUND[base].text
    file = tmp_path / "asset.usda"

    def picture(unit: float) -> Floats32:
        file.write_text(text.replace("metersPerUnit = 0.5", f"metersPerUnit = {unit!r}"))
        return paint.picture(tmp_path, job('usd = "asset.usda"'))

    expected = picture(0.5)
    radius = read_usd(compose(Composition(file))).radius / 0.5
    for size in (1.05e-6, 1e-3, 1e4, 0.95e9):
        assert difference(picture(size / radius), expected) <= CLOSE, size


def _rendered(folder: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the picture of a job, by a worker of its own, and the notes."""
    prepared = plan_job(load_job(folder / "job.toml"))
    with open_renderer() as render:
        frame = render(prepared.plan.frames[0].task)
    return np.stack([frame.a, frame.b]), (*prepared.notes, *frame.notes)


@pytest.mark.proof
def test_a_damaged_cache_shows_the_same_picture(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = tmp_path / "cache"
    monkeypatch.setenv("LOOKDEV_CACHE", str(cache))
    (tmp_path / "asset.usda").write_text(SOUND["cage"].text)
    exr(RGB)(tmp_path / "sky.exr", random.Random(0))
    PRODUCTS["document"](tmp_path)
    PRODUCTS["package"](tmp_path)
    look = table(material="look.usdz", assign=[{"prims": ["/Root/Loop"], "material": "look.mtlx"}])
    (tmp_path / "job.toml").write_text(job('usd = "asset.usda"', look, 'file = "sky.exr"'))
    picture, _ = _rendered(tmp_path)
    shutil.copytree(cache, tmp_path / "sound")
    files = sorted(file.relative_to(cache) for file in cache.rglob("*") if file.is_file())
    random.Random(0).shuffle(files)
    assert {file.parent.name for file in files} > {"content", "assets", "refined"}
    for number, name in enumerate(files):
        shutil.rmtree(cache)
        shutil.copytree(tmp_path / "sound", cache)
        way = list(WAYS)[number % len(WAYS)]
        WAYS[way](cache / name, random.Random(number))
        if name.parent.name == "textures":
            # Code that was generated names its images by content: these records are read to generate it alone.
            shutil.rmtree(cache / "sources")
        again, notes = _rendered(tmp_path)
        np.testing.assert_array_equal(again, picture, f"{name}: {way}")
        assert f"{cache / name}: was damaged, and is made again" in notes
