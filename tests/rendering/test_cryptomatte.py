"""Names and mattes of Cryptomatte, compared with published values and a straightforward sum."""

import json
from collections import defaultdict

import numpy as np

from lookdev.rendering.cryptomatte import RANKS, matte_header, matte_id, murmur3, normalize_coverage, rename_ids

# From the reference implementation of MurmurHash3 (SMHasher), as its ports test it.
HASHES = {
    "": 0x00000000,
    "a": 0x3C2569B2,
    "abc": 0xB3DD93FA,
    "test": 0xBA6BD213,
    "Hello, world!": 0xC0363E43,
    "The quick brown fox jumps over the lazy dog": 0x2E4FF723,
}


def test_hashes_are_those_of_the_reference() -> None:
    assert {text: murmur3(text) for text in HASHES} == HASHES


def test_ids_are_plain_floats() -> None:
    names = [f"/prim_{i}" for i in range(20000)]
    ids, hashes = (np.array([number(name) for name in names], np.uint32) for number in (matte_id, murmur3))
    exponents = ids >> 23 & 255
    assert (exponents.min(), exponents.max()) == (1, 254)
    # Where the hash has no such exponent, its lowest bit is changed alone.
    assert {*(ids ^ hashes)} == {0, 1 << 23}


def test_a_header_names_what_is_in_the_matte() -> None:
    header = matte_header("CryptoObject", ["/b/é", "/a"])
    assert {key.split("/")[1] for key in header} == {"3ae39a5"}  # as the specification has it
    by_name = {key.split("/")[2]: text for key, text in header.items()}
    assert by_name.pop("manifest")
    assert by_name == {"name": "CryptoObject", "hash": "MurmurHash3_32", "conversion": "uint32_to_float32"}
    manifest = json.loads(header["cryptomatte/3ae39a5/manifest"])
    assert list(manifest) == ["/a", "/b/é"]
    assert int(manifest["/a"], 16) == matte_id("/a")


def test_renamed_things_are_summed_and_the_largest_kept() -> None:
    rng = np.random.default_rng(3)
    names = {f"item.{i:03}": f"/thing_{i // 3}" for i in range(40)}
    olds = np.array([matte_id(name) for name in [*names, "unknown"]], np.uint32)
    mattes = np.zeros((5, 7, 32), np.float32)
    for pixel in np.ndindex(5, 7):
        count = rng.integers(0, 17)
        selection = rng.permutation(len(olds))[:count]
        mattes[(*pixel, slice(0, 2 * count, 2))] = olds[selection].view(np.float32)
        mattes[(*pixel, slice(1, 2 * count, 2))] = rng.random(count)
    ranked = rename_ids(mattes, names)
    assert ranked.shape == (5, 7, 2 * RANKS)
    new_of = {matte_id(old): matte_id(new) for old, new in names.items()}
    for pixel in np.ndindex(5, 7):
        sums: dict[int, float] = defaultdict(float)
        for ident, coverage in zip(mattes[pixel][0::2].view(np.uint32), mattes[pixel][1::2], strict=True):
            if int(ident) in new_of and coverage > 0.0:
                sums[new_of[int(ident)]] += float(coverage)
        expected = sorted(sums.items(), key=lambda item: -item[1])[:RANKS]
        ids, coverages = ranked[pixel][0::2].copy().view(np.uint32), ranked[pixel][1::2]
        expected += [(0, 0.0)] * (RANKS - len(expected))
        assert ids.tolist() == [ident for ident, _ in expected]
        np.testing.assert_allclose(coverages, [coverage for _, coverage in expected], rtol=1e-6)


def test_filled_mattes_sum_up_to_alpha() -> None:
    mattes = np.zeros((3, 3, 4), np.float32)
    mattes[1, 1] = [5.0, 0.25, 6.0, 0.5]
    alpha = np.array([[0, 0.1, 0], [0, 0.6, 0.02], [0, 0, 0]], np.float32)
    full = normalize_coverage(mattes, alpha)
    np.testing.assert_allclose(full[..., 1::2].sum(axis=-1), alpha, rtol=1e-6)
    np.testing.assert_allclose(full[1, 1], [5.0, 0.2, 6.0, 0.4], rtol=1e-6)
    np.testing.assert_array_equal(full[1, 2, 0::2], [5.0, 6.0])
