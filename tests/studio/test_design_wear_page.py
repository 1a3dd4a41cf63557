"""Parts dressed on the Designer's page in headless Chromium, and written into the job."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from served import Served, served
from test_design_layers_page import run
from test_design_page import NEEDS_CHROMIUM, Page, start_browser

from lookdev.job import load_job

pytestmark = NEEDS_CHROMIUM

ROOT = Path(__file__).parents[2]
JOB = """output = "out"
asset = { usd = "toy_car.usda" }

[[look]]
name = "shop"                # the car as it comes

[[ibl]]
name = "studio"
builtin = "studio"

[[turntable]]
kind = "element"
frames = 1
"""
DRESS = (
    "const dress = async (part, prims, look) => { typed(at('part'), part); await until(() => at('wear'));"
    " at('wear').click(); await until(() => at('dressing').open);"
    " const options = [...at('dressing-prims').options];"
    " typed(at('dressing-prims'), options.find((each) => each.text.startsWith(prims)).value, 'input');"
    " typed(at('dressing-search'), look, 'input'); at('dressing-looks').querySelector('button').click();"
    " await until(() => !at('dressing').open); };"
    "const hubs = () => [...at('part').options].filter((each) => each.text.endsWith('Hub')).length;"
    "const wears = () => at('worn').querySelector('.wears').textContent;"
)


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dressed")
    for file in ("jobs/assets/toy_car.usda", "materials/frosted_plastic.usda", "materials/brushed_metal.usda"):
        shutil.copy(ROOT / file, folder)
    shutil.copytree(ROOT / "materials" / "textures", folder / "textures")
    (folder / "job.toml").write_text(JOB)
    return folder / "job.toml"


@pytest.fixture(scope="module")
def server(job: Path) -> Iterator[Served]:
    with served(str(job), verb="design", cwd=job.parent) as started:
        yield started


def test_parts_are_dressed_and_the_job_says_so(server: Served, job: Path) -> None:
    for browser in start_browser():
        page = Page(browser, server.url)
        found = run(
            page,
            DRESS + "const states = [];"
            "await dress('/Car/Body', 'this part', 'frosted'); await until(() => wears().startsWith('FrostedPlastic'));"
            "states.push(wears(), at('undo').title);"
            "await dress('/Car/Wheels/FrontLeft/Hub', 'only /Car/Wheels/FrontLeft/Hub', 'brushed');"
            "await until(() => wears().startsWith('BrushedMetal'));"
            "states.push(wears(), hubs());"
            "at('undo').click(); await until(() => hubs() === 1);"
            "at('redo').click(); await until(() => hubs() === 2);"
            "await dress('/Car/Lamps/Left', '/Car.collection:trim', 'brushed');"
            "await until(() => wears().startsWith('BrushedMetal')); states.push(wears());"
            "await until(() => !at('wear-off').disabled); at('wear-off').click();"
            "await until(() => !wears().startsWith('BrushedMetal')); states.push(wears());"
            "at('save').click(); await until(() => at('status').textContent.startsWith('saved'));"
            "states.push(at('status').textContent.split('/').pop(), at('save').disabled); done(states);",
        )
        assert found == [
            "FrostedPlasticassigned to /Car/Body",
            "Undo: /Car/Body wears frosted_plastic (Ctrl+Z)",
            "BrushedMetalassigned to /Car/Wheels/FrontLeft/Hub",
            2,
            "BrushedMetalassigned to /Car.collection:trim",
            "Chromeas the asset has it",
            "job.toml",
            True,
        ]
    assert job.read_text().startswith(JOB.partition("\n\n[[ibl]]")[0])
    worn = {each.prims: each.material.name for each in load_job(job).look[0].assign}
    assert worn == {
        ("/Car/Wheels/FrontLeft/Hub",): "brushed_metal.usda",
        ("/Car/Body",): "frosted_plastic.usda",
    }


def test_a_new_look_is_made_of_a_preset_and_a_wrong_pattern_is_named(server: Served, job: Path) -> None:
    for browser in start_browser():
        page = Page(browser, server.url)
        found = run(
            page,
            DRESS + "typed(at('part'), '/Car/Chimney'); await until(() => at('wear'));"
            "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 'p', bubbles: true}));"
            "await until(() => at('dressing').open);"
            "typed(at('dressing-prims'), 'typed', 'input'); typed(at('dressing-typed'), '/Car/Ch*', 'input');"
            "const fits = [at('dressing-fits').textContent]; typed(at('dressing-typed'), '/Car/X', 'input');"
            "fits.push(at('dressing-fits').textContent); typed(at('dressing-typed'), '/Car/Ch*', 'input');"
            "at('dressing').querySelector('[value=preset]').click();"
            "await until(() => at('adding').open && at('adding-presets').childElementCount > 60);"
            "typed(at('adding-search'), 'red plastic', 'input'); at('adding-presets').querySelector('button').click();"
            "await until(() => at('naming').open); const name = at('name').value; typed(at('name'), 'pipe.usda');"
            "at('naming-save').click(); await until(() => wears().startsWith('Pipe')); done([...fits, name, wears()]);",
        )
        assert found == ["fits 1 of 13 parts", "fits no part", "red_plastic.usda", "Pipeassigned to /Car/Ch*"]
    assert (job.parent / "pipe.usda").is_file()
