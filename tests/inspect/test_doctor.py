import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

from lookdev.errors import RenderError
from lookdev.inspect import doctor
from lookdev.inspect.doctor import BLENDER_PYTHONS, DoctorFinding, examine_machine, findings_text
from lookdev.rendering.llvm import LLVM_VARIABLE, OLDEST_LLVM, find_llvm

VERSION = BLENDER_PYTHONS[sys.version_info[:2]]
BPY = (sys.executable, "-c", f"print('a word of a library'); print('{VERSION}.7 LTS')")
# Not by an import, which is for the whole process: Dr.Jit looks for LLVM then, and at no other time.
needs_mitsuba = pytest.mark.skipif(not find_spec("mitsuba"), reason="Mitsuba is not installed")
SELF_TEST = (sys.executable, "-c", "print('{\"osl\": true}')")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LOOKDEV_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv(LLVM_VARIABLE, "libLLVM.so")
    return tmp_path / "cache"


def findings_by_subject(bpy: tuple[str, ...] = BPY, self_test: tuple[str, ...] = SELF_TEST) -> dict[str, DoctorFinding]:
    return {finding.subject: finding for finding in examine_machine(bpy, self_test)}


def program(text: str) -> tuple[str, ...]:
    return (sys.executable, "-c", text)


def test_a_good_machine(cache: Path) -> None:
    findings = findings_by_subject()
    assert all(finding.good for finding in findings.values())
    assert not any(finding.remedy for finding in findings.values())
    assert findings["bpy (Blender)"].state == f"{VERSION}.7 LTS"
    assert set(doctor.MODULES) < set(findings)
    assert list(cache.iterdir()) == []


def test_a_missing_system_library_names_its_debian_package() -> None:
    error = "ImportError: libXrender.so.1: cannot open shared object file: No such file or directory"
    findings = findings_by_subject(bpy=program(f"import sys; sys.exit('{error}')"))
    bpy = findings["bpy (Blender)"]
    assert (bpy.good, bpy.state, bpy.remedy) == (False, error, "sudo apt-get install libxrender1")
    assert "OSL in Cycles" not in findings


def test_all_missing_system_libraries_are_one_command(monkeypatch: pytest.MonkeyPatch) -> None:
    there = next(iter(doctor.SYSTEM_LIBRARIES))
    libraries = {there: "here", "libnowhere.so.1": "libnowhere1", "libneither.so.6": "libneither6"}
    monkeypatch.setattr(doctor, "SYSTEM_LIBRARIES", libraries)
    lacks, remedy = "lacks libnowhere.so.1, libneither.so.6", "sudo apt-get install libneither6 libnowhere1"
    assert findings_by_subject()["system libraries"] == DoctorFinding("system libraries", lacks, False, remedy)


CRASH = "import os; os.kill(os.getpid(), 11)"


@pytest.mark.parametrize("text", ["import sys; sys.exit('ModuleNotFoundError: bpy')", "print('1.23.4')", CRASH])
def test_a_missing_wrong_or_crashing_blender_names_the_wheel(text: str) -> None:
    bpy = findings_by_subject(bpy=program(text))["bpy (Blender)"]
    assert bpy.state
    assert (bpy.good, bpy.remedy) == (False, f"python -m pip install 'bpy=={VERSION}.*'")


@pytest.mark.parametrize(
    ("text", "findings"),
    [
        ("import sys; sys.exit('no oslquery')", "no oslquery"),
        ("print('Blender quit')", "answered 'Blender quit'"),
        ("print('{}'); import os; os._exit(5)", "exit code 5"),
    ],
)
def test_osl_that_does_not_work(text: str, findings: str) -> None:
    osl = findings_by_subject(self_test=program(text))["OSL in Cycles"]
    assert (osl.good, osl.state, bool(osl.remedy)) == (False, findings, True)


def test_a_missing_dependency_names_its_distribution(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "MODULES", {"usd-nowhere": "pxr_nowhere.Usd", "lookdev": "lookdev"})
    findings = findings_by_subject()
    assert findings["usd-nowhere"].remedy == "python -m pip install usd-nowhere"
    assert "pxr_nowhere" in findings["usd-nowhere"].state
    assert findings["lookdev"].good


def test_another_python_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "BLENDER_PYTHONS", {(2, 7): "2.79"})
    findings = findings_by_subject()
    assert (findings["Python"].good, findings["bpy (Blender)"].good) == (False, False)
    assert "2.7" in findings["Python"].remedy


def test_a_cache_that_cannot_be_written_or_on_a_full_disk(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(doctor, "FREE_DISK", 1e9)
        full = findings_by_subject()["cache folder"]
    assert (full.good, "GB free" in full.state) == (False, True)
    cache.rmdir()
    cache.write_text("a file where a folder should be")
    unwritable = findings_by_subject()["cache folder"]
    assert (unwritable.good, "LOOKDEV_CACHE" in unwritable.remedy) == (False, True)


def test_a_description_has_a_line_for_each_remedy() -> None:
    text = findings_text(
        [DoctorFinding("Python", "3.11", good=True), DoctorFinding("bpy", "gone", good=False, remedy="get it")]
    )
    assert text == "ok       Python  3.11\nMISSING  bpy     gone\n                 to get it: get it"


def test_the_newest_llvm_is_taken_and_an_old_one_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: object())
    monkeypatch.setenv(LLVM_VARIABLE, "/opt/libLLVM.so")
    assert find_llvm(tmp_path) == "/opt/libLLVM.so"
    monkeypatch.delenv(LLVM_VARIABLE)

    def newest(*names: str) -> str:
        """Return the newest library where further ones are installed."""
        for name in names:
            file = tmp_path / "usr" / "lib" / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.touch()
        return find_llvm(tmp_path).removeprefix(f"{tmp_path}/usr/lib/")

    with pytest.raises(RenderError, match=r"found: none: install it \(on Debian libllvm19\)"):
        newest()
    with pytest.raises(RenderError, match=f"found: version {OLDEST_LLVM - 1}"):
        newest(f"x86_64-linux-gnu/libLLVM-{OLDEST_LLVM - 1}.so.1")
    assert newest("x86_64-linux-gnu/libLLVM-16.so.1", "llvm-17/lib/libLLVM-17.so") == "llvm-17/lib/libLLVM-17.so"
    assert newest("x86_64-linux-gnu/libLLVM.so.19.1") == "x86_64-linux-gnu/libLLVM.so.19.1"
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(RenderError, match=r"pip install 'lookdev\[mitsuba\]'"):
        find_llvm(tmp_path)


@needs_mitsuba
def test_mitsuba_needs_llvm_by_its_package_and_says_whether_a_gpu_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing() -> str:
        raise RenderError("found: none")

    monkeypatch.setattr(doctor, "find_llvm", lambda: "libLLVM.so.19")
    for fault, words in (("no driver here", "no driver here"), (None, "an NVIDIA GPU is there")):
        monkeypatch.setattr(doctor, "gpu_fault", lambda fault=fault: fault)
        findings = findings_by_subject()["Mitsuba"]
        assert findings.good
        assert findings.state.endswith(f'libLLVM.so.19; device = "cuda": {words}')
    monkeypatch.setattr(doctor, "find_llvm", missing)
    assert findings_by_subject()["Mitsuba"] == DoctorFinding(
        "Mitsuba", "found: none", False, "sudo apt-get install libllvm19"
    )
