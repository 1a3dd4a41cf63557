import json
from pathlib import Path

import pytest
from minimal_job import MINIMAL

from lookdev.errors import JobError
from lookdev.job import parse_job
from lookdev.job.mapping import map_path, read_rules


def write(file: Path, *rules: tuple[str, str, str]) -> Path:
    keys = ("source_path_format", "source_path", "destination_path")
    data = {"version": "pathmapping-1.0", "path_mapping_rules": [dict(zip(keys, rule, strict=True)) for rule in rules]}
    file.write_text(json.dumps(data))
    return file


@pytest.mark.parametrize(
    ("path", "expected"),
    [
        ("/show/looks/a.usda", "/mnt/looks/a.usda"),
        ("/show/plates/sky.exr", "/plates/sky.exr"),  # the longer source
        ("/showroom/a.usda", "/showroom/a.usda"),
        (r"P:\show\a.usda", "/mnt/p/a.usda"),
        ("p:/Show/sub/a.usda", "/mnt/p/sub/a.usda"),
        ("looks/a.usda", "looks/a.usda"),
    ],
)
def test_paths_are_where_the_longest_rule_says(tmp_path: Path, path: str, expected: str) -> None:
    rules = [("POSIX", "/show", "/mnt"), ("POSIX", "/show/plates", "/plates"), ("WINDOWS", r"P:\show", "/mnt/p")]
    assert map_path(path, read_rules(write(tmp_path / "rules.json", *rules))) == expected


def test_a_job_finds_its_files_by_rules(tmp_path: Path) -> None:
    (tmp_path / "paint.usda").touch()
    rules = read_rules(write(tmp_path / "rules.json", ("POSIX", "/elsewhere", str(tmp_path))))
    text = MINIMAL.replace('"out"', '"/elsewhere/out"').replace('"paint.usda"', '"/elsewhere/paint.usda"')
    job = parse_job(text, tmp_path / "job.toml", rules)
    assert (job.output, job.look[0].material) == (tmp_path / "out", tmp_path / "paint.usda")
    with pytest.raises(JobError, match=r"no readable file /elsewhere/paint\.usda"):
        parse_job(text, tmp_path / "job.toml")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"version": "2"}', "pathmapping-1.0"),
        ('{"version": "pathmapping-1.0", "path_mapping_rules": [{"source_path": "/a"}]}', r"rules\[0\]: needs"),
        ("{", "rules.json"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "rules.json").write_text("{}")
    assert read_rules(tmp_path / "rules.json") == ()  # of a session without rules
    (tmp_path / "rules.json").write_text(text)
    with pytest.raises(JobError, match=message):
        read_rules(tmp_path / "rules.json")
