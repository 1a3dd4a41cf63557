"""The fixture `stored_reference`: float64 references for tests, read from files because they take long to compute.

``stored_reference(name, compute, **inputs)`` returns the arrays that ``compute(**inputs)`` returns, by name, from the
file ``tests/references/<name>-<digest>.npz``. The digest depends on the inputs, not on the code. A fault in the code
therefore does not change the stored reference, and the test detects it. A test fails if its file is missing, and names
the command that writes it.

``python -m pytest -m "proof or not proof" --renew-references PATH`` writes the files for the tests in PATH; without a
PATH it also deletes files that no test uses. A run with ``-m proof`` also runs the tests of other tiers that use the
fixture, and recomputes their references to compare them with the files. Tests that are themselves marked `proof` always
compute, and store nothing.
"""

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from numpy.typing import NDArray

from lookdev.asset import Asset
from lookdev.cache import Content
from lookdev.light import Dome
from lookdev.material.expression import Expression

Arrays = Mapping[str, NDArray[Any]]
StoredReference = Callable[..., Arrays]

FOLDER = Path(__file__).parent / "references"
EVERY = "proof or not proof"  # the markers that select all tests
RENEW, RECOMPUTE = "--renew-references", "--recompute-references"
RTOL = 1e-9
"""The relative tolerance between a stored value and a recomputed one.

The last digits of NumPy's results differ between processors. Faults of models and noise are larger: above 1e-5.
"""

_WHOLE = 64  # an array with at most this number of numbers enters the digest with all of them
_IS_PROOF = pytest.StashKey[bool]()  # whether a test is itself marked `proof`
_USED = pytest.StashKey[set[Path]]()  # the files that tests of the run have used


def pytest_addoption(parser: pytest.Parser) -> None:
    group = parser.getgroup("lookdev")
    group.addoption(RENEW, action="store_true", help="compute the references in tests/references, and write them")
    group.addoption(RECOMPUTE, action="store_true", help="compute the references too, and compare them with the files")


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_USED] = set()


@pytest.hookimpl(tryfirst=True)  # before pytest deselects the tests of other tiers
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """In a run with ``-m proof``, also mark the tests that use stored references."""
    proof = config.getoption("markexpr") == "proof"
    for item in items:
        item.stash[_IS_PROOF] = item.get_closest_marker("proof") is not None
        if proof and "stored_reference" in item.fixturenames:  # type: ignore[attr-defined]
            item.add_marker(pytest.mark.proof)


@pytest.fixture
def stored_reference(request: pytest.FixtureRequest) -> StoredReference:
    """Return a function (name, compute, **inputs) that returns the arrays of a reference; see the module.

    With ``recompute=True`` the function computes them in every run, and compares them with the file. Tests request this
    for one cheap case of each `compute`.
    """
    config, proof = request.config, request.node.stash[_IS_PROOF]
    renew = bool(config.getoption(RENEW))
    always = bool(config.getoption(RECOMPUTE)) or config.getoption("markexpr") == "proof"

    def arrays(label: str, /, compute: Callable[..., Arrays], *, recompute: bool = False, **inputs: Any) -> Arrays:
        if proof:
            return compute(**inputs)
        stem = re.sub(r"[^a-z0-9]+", "-", label.lower()).strip("-")
        file = FOLDER / f"{stem}-{digest_of(compute.__name__, inputs)}.npz"
        if renew:
            _renew(file, compute(**inputs))
        config.stash[_USED].add(file)
        if not file.exists():
            others = ", ".join(sorted(other.name for other in FOLDER.glob(f"{stem}-*.npz"))) or "none"
            pytest.fail(
                f"there is no reference {file.name}; of the same name, with other inputs: {others}. To write it:\n"
                f"{renew_command(request.node)}",
                pytrace=False,
            )
        request.node.user_properties.append(("reference", file.name))
        stored = load_reference(file)
        if recompute or always:
            assert_same(file.name, stored, compute(**inputs))
        return stored

    return arrays


def renew_command(item: pytest.Item) -> str:
    """Return the command that writes the references of a test."""
    return f'python -m pytest -m "{EVERY}" {RENEW} "{item.nodeid}"'


@lru_cache(64)
def load_reference(file: Path) -> Arrays:
    """Return the arrays in a file by their names."""
    with np.load(file, allow_pickle=False) as stored:
        return dict(stored)


def assert_same(name: str, stored: Arrays, computed: Arrays) -> None:
    """Assert that the stored arrays have the names and, within `RTOL`, the values of the computed ones."""
    assert stored.keys() == computed.keys(), name
    for key, values in computed.items():
        scale = RTOL * np.abs(values).max(initial=0.0)
        np.testing.assert_allclose(stored[key], values, rtol=RTOL, atol=scale, err_msg=f"{key} of {name} is stale")


def _renew(file: Path, computed: Arrays) -> None:
    """Write arrays to a file, unless it has exactly these."""
    arrays = {key: np.asarray(values) for key, values in computed.items()}
    FOLDER.mkdir(exist_ok=True)
    if not file.exists() or not _equal(load_reference(file), arrays):
        np.savez_compressed(file, **arrays)
    load_reference.cache_clear()


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """After a run of all tests that renewed the references, delete the files that no test has used."""
    config = session.config
    is_whole = config.args_source is not pytest.Config.ArgsSource.ARGS and not config.getoption("keyword")
    if config.getoption(RENEW) and is_whole and config.getoption("markexpr") == EVERY and exitstatus == 0:
        for file in FOLDER.glob("*.npz"):
            if file not in config.stash[_USED]:
                file.unlink()


def _equal(stored: Arrays, computed: Arrays) -> bool:
    return stored.keys() == computed.keys() and all(np.array_equal(stored[key], computed[key]) for key in computed)


def digest_of(name: str, inputs: Mapping[str, Any]) -> str:
    """Return a digest of the inputs of the function `name`; it is the same on every machine and in every folder."""
    return hashlib.sha256(json.dumps([name, describe(inputs)], sort_keys=True).encode()).hexdigest()[:12]


def describe(value: Any) -> Any:
    """Return plain data that identify a value, for a digest.

    Other versions of a library compute other last digits. Numbers are therefore rounded to nine digits, and large
    arrays and images are described by moments of their values. Assets are described by names, sizes and placements,
    domes by their map.
    """
    match value:
        case None | bool() | int() | str():
            return value
        case float() | np.floating():
            return f"{float(value):.9g}"
        case np.ndarray() | np.integer() | np.bool_():
            return _array(np.asarray(value))
        case Mapping():
            return {str(key): describe(value[key]) for key in value}
        case tuple() | list():
            return [describe(element) for element in value]
        case set() | frozenset():
            return sorted(describe(element) for element in value)
        case Content():
            return _file(value.path)
        case Path():
            return _file(value)
        case Asset():
            meshes = [[mesh.name, len(mesh.points), sorted([*mesh.uvs, *mesh.primvars])] for mesh in value.meshes]
            placed = [[instance.mesh, instance.path, describe(instance.matrix)] for instance in value.instances]
            return [value.name, meshes, placed, [slot.path for slot in value.slots]]
        case Expression():
            return value.text
        case Dome():
            return ["Dome", _array(value.table), describe(value.axes), describe(value.emission)]
    if is_dataclass(value) and not isinstance(value, type):
        # The fields that differ from their defaults, with their numbers. So the digest stays the same if a field is
        # renamed, or if a field with a default is appended.
        field_values = [[number, describe(getattr(value, field.name))] for number, field in enumerate(fields(value))]
        defaults = [_default(field) for field in fields(value)]
        return [getattr(value, "kind", ""), *(pair for pair in field_values if pair[1] != defaults[pair[0]])]
    raise TypeError(f"{type(value).__name__} is no input of a stored reference: plain data would be right")


def _default(field: Field[Any]) -> Any:
    """Return the description of a field's default, or MISSING."""
    if field.default is not MISSING:
        return describe(field.default)
    return MISSING if field.default_factory is MISSING else describe(field.default_factory())


def _array(values: NDArray[Any]) -> Any:
    """Return the description of an array: all its values, or its root mean square and two moments; and its shape."""
    if values.size <= _WHOLE:
        return [describe(number) for number in values.ravel().tolist()] + [list(values.shape)]
    flat = values.ravel().astype(np.float64)
    root_mean_square = float(np.sqrt(np.mean(flat**2)))
    weights = np.arange(len(flat)) * 0.6180339887498949 % 1.0  # as irregular as random ones
    moments = [float(np.mean(flat * weight)) / (root_mean_square or 1.0) for weight in (1.0, weights)]
    return [
        list(values.shape),
        f"{root_mean_square:.5g}",
        *(f"{moment:+.5f}".replace("-0.00000", "+0.00000") for moment in moments),
    ]


def _file(file: Path) -> Any:
    """Return the description of a file: that of the array or image in it, or a hash of its bytes."""
    match file.suffix:
        case ".npy":
            return _array(np.load(file))
        case ".exr" | ".png":
            return _array(np.asarray(oiio.ImageBuf(str(file)).get_pixels(oiio.FLOAT)))
    return hashlib.sha256(file.read_bytes()).hexdigest()
