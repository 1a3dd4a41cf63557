"""Looks assigned to parts on the Designer's page in headless Chromium, and written into the job."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from design_page import ASSIGN, DesignPage
from served import start_server
from usd_text import job_toml, material

from lookdev.job import load_job

JOB = job_toml(asset='{ usd = "toy_car.usda" }') + '\n[[look]]\nname = "shop"  # the car as it comes\n'


def matt(name: str, scope: str = "") -> str:
    """Return a material whose shader compiles fast."""
    return material(name, scope=scope).replace("LookdevDisney", "LookdevLambert")


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory, toy_car: str) -> Path:
    """Return a job of the toy car, all in one look, with looks beside it."""
    folder = tmp_path_factory.mktemp("assigned")
    before, chrome = toy_car.split('def Material "Chrome"')
    toy_car = before + matt("Chrome", "/Car/Looks") + chrome.partition("\n        }\n")[2]
    (folder / "toy_car.usda").write_text(re.sub("</Car/Looks/(Paint|Glass|Rubber)>", "</Car/Looks/Chrome>", toy_car))
    for file, name in (("frosted_plastic", "FrostedPlastic"), ("brushed_metal", "BrushedMetal")):
        (folder / f"{file}.usda").write_text(f'#usda 1.0\n( defaultPrim = "{name}" )\n{matt(name)}')
    (folder / "job.toml").write_text(JOB)
    return folder / "job.toml"


@pytest.fixture(scope="module")
def open_page(job: Path, tab: Any) -> Iterator[DesignPage]:
    with start_server(str(job), verb="design", cwd=job.parent) as started:
        page = DesignPage(tab, started.url)
        page.js("at('shadows').click()")  # rays to occluders take longer than all else that is tested here
        yield page


@pytest.fixture
def page(open_page: DesignPage, job: Path) -> Iterator[DesignPage]:
    """Return the page; what a test edits is undone afterwards, and the job is as it was."""
    yield open_page
    open_page.js(
        "while (!at('undo').disabled) { at('undo').click(); await pause(0); await designer.settle(); }"
        "await answered();"
        "if (!at('save').disabled) await saved();"
    )
    assert job.read_text() == JOB


def test_looks_are_assigned_to_parts_and_the_job_says_so(page: DesignPage, job: Path) -> None:
    assert page.js(
        ASSIGN + "const states = [];"
        "await assign('/Car/Body', 'this part', 'frosted'); await until(() => partLook().startsWith('FrostedPlastic'));"
        "states.push(partLook(), at('undo').title);"
        "await assign('/Car/Wheels/FrontLeft/Hub', 'only /Car/Wheels/FrontLeft/Hub', 'brushed');"
        "await until(() => partLook().startsWith('BrushedMetal'));"
        "states.push(partLook(), hubs());"
        "at('undo').click(); await until(() => hubs() === 1);"
        "at('redo').click(); await until(() => hubs() === 2);"
        "await assign('/Car/Lamps/Left', '/Car.collection:trim', 'brushed');"
        "await until(() => partLook().startsWith('BrushedMetal')); states.push(partLook());"
        "await until(() => !at('unassign-look').disabled); at('unassign-look').click();"
        "await until(() => !partLook().startsWith('BrushedMetal')); states.push(partLook());"
        "await answered(); states.push((await saved()).split('/').pop(), at('save').disabled); return states;"
    ) == [
        "FrostedPlasticassigned to /Car/Body",
        "Undo: assign frosted_plastic to /Car/Body (Ctrl+Z)",
        "BrushedMetalassigned to /Car/Wheels/FrontLeft/Hub",
        2,
        "BrushedMetalassigned to /Car.collection:trim",
        "Chromeas the asset has it",
        "job.toml",
        True,
    ]
    assert job.read_text().startswith(JOB)
    assert {table.prims: table.material.name for table in load_job(job).look[0].assign} == {
        ("/Car/Wheels/FrontLeft/Hub",): "brushed_metal.usda",
        ("/Car/Body",): "frosted_plastic.usda",
    }


def test_a_new_look_is_made_of_a_preset_and_a_wrong_pattern_is_named(page: DesignPage, job: Path) -> None:
    assert page.js(
        ASSIGN + "typed(at('part'), '/Car/Chimney'); await until(() => at('assign-look'));"
        "document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 'p', bubbles: true}));"
        "await until(() => at('assigning').open);"
        "typed(at('assigning-prims'), 'typed', 'input'); typed(at('assigning-typed'), '/Car/Ch*', 'input');"
        "const fits = [at('assigning-fits').textContent]; typed(at('assigning-typed'), '/Car/X', 'input');"
        "fits.push(at('assigning-fits').textContent); typed(at('assigning-typed'), '/Car/Ch*', 'input');"
        "at('assigning').querySelector('[value=preset]').click();"
        "await until(() => at('adding').open && at('adding-presets').childElementCount > 60);"
        "typed(at('adding-search'), 'red plastic', 'input'); at('adding-presets').querySelector('button').click();"
        "await until(() => at('naming').open); const name = at('name').value; typed(at('name'), 'pipe.usda');"
        "at('naming-save').click(); await until(() => partLook().startsWith('Pipe')); await answered();"
        "return [...fits, name, partLook()];"
    ) == ["fits 1 of 13 parts", "fits no part", "red_plastic.usda", "Pipeassigned to /Car/Ch*"]
    assert (job.parent / "pipe.usda").is_file()
