"""The verbs of a job's output: review, manifest."""

import json
import os
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "output"))
import review_case


def test_a_page_is_written_and_kept(run_cli, tmp_path):
    out = review_case.write_job(tmp_path / "out", ["gold"], ["city"], {"element": 2})
    for counts in ("0 kept", "0 files made"):
        code, output, errors = run_cli("review", out, "-o", tmp_path / "page")
        assert (code, errors, counts in output) == (0, "", True)
        assert output.startswith(f"{tmp_path / 'page' / 'index.html'}: ")


def test_damaged_frames_are_notes_and_a_folder_without_frames_is_exit_code_1(run_cli, tmp_path):
    out = review_case.write_job(tmp_path / "out", ["gold"], ["city"], {"element": 2})
    damaged = out / "gold" / "city" / "element.0002.exr"
    os.truncate(damaged, 300)
    code, _, errors = run_cli("review", out)
    assert code == 0
    assert errors.startswith(f"note: {damaged}: is left out: ")
    (tmp_path / "empty").mkdir()
    for words, message in ((["empty"], "has no frames"), (["out", "--view", "Rav"], "did you mean 'Raw'")):
        code, _, errors = run_cli("review", tmp_path / words[0], *words[1:])
        assert (code, message in errors) == (1, True)


def test_render_writes_a_manifest_that_is_verified(run_cli, job_file, tmp_path):
    assert run_cli("render", job_file)[0] == 0
    out = tmp_path / "out"
    code, output, errors = run_cli("manifest", out)
    assert (code, errors) == (0, "")
    assert output.startswith(f"{out / 'manifest.json'}: 7 of 7 frames, 9 pictures, 2 inputs, largest relMSE ")
    code, output, _ = run_cli("manifest", out, "--verify")
    assert (code, output.splitlines()[-1]) == (0, "all files are as they are listed")
    assert run_cli("review", out)[0] == 0
    assert '"name": "Raw (sRGB - Display)"' in (out / "review" / "data" / "index.js").read_text()
    frame = out / "gold" / "city" / "element.0002.exr"
    frame.unlink()
    code, output, _ = run_cli("manifest", out, "--verify")
    assert (code, output.splitlines()[1:]) == (1, [f"missing: frame {frame}", "1 files are not as they are listed"])
    code, output, _ = run_cli("manifest", out, "--verify", "--json")
    assert (code, json.loads(output)["deviations"]) == (1, [{"file": str(frame), "kind": "frame", "state": "missing"}])
    code, output, _ = run_cli("render", job_file, "--frame", "gold/city/element.0002")
    assert code == 0
    assert run_cli("manifest", out, "--verify")[0] == 0


def test_no_manifest_is_exit_code_1(run_cli, tmp_path):
    for options in ((), ("--verify",)):
        code, _, errors = run_cli("manifest", tmp_path, *options)
        assert (code, "'lookdev render' of the job writes" in errors) == (1, True), options
