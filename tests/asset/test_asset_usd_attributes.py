"""The one door for values of attributes: type, shape and range."""

import re

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, Vt

from lookdev.asset.usd.attributes import read_array, read_matrix, read_number, read_texts, read_token
from lookdev.errors import AssetError

TYPES = Sdf.ValueTypeNames
BROKEN = Gf.Matrix4d(np.inf)
NOW = Usd.TimeCode.EarliestTime()


@pytest.fixture
def stage():
    return Usd.Stage.CreateInMemory()


@pytest.fixture
def author(stage):
    """Return a function that makes a prim with an attribute."""

    def make(kind, value):
        prim = stage.DefinePrim("/P")
        prim.CreateAttribute("a", kind).Set(value)
        return prim

    return make


@pytest.mark.parametrize(
    ("kind", "value", "number", "shape"),
    [
        *((kind, [(1, 2, 3)], np.float64, (3,)) for kind in (TYPES.Float3Array, TYPES.Double3Array, TYPES.Half3Array)),
        (TYPES.Point3fArray, [], np.float64, (3,)),
        (TYPES.FloatArray, [1.0, -1e18], np.float64, ()),
        (TYPES.QuathArray, [Gf.Quath(1.0)], np.float64, (4,)),
        (TYPES.Matrix4dArray, [Gf.Matrix4d(2.0)], np.float64, (4, 4)),
        (TYPES.IntArray, [1, -2], np.intp, ()),
        (TYPES.Int64Array, [1 << 40], np.intp, ()),
        (TYPES.UCharArray, [1], np.intp, ()),
    ],
)
def test_arrays_of_the_type_that_is_needed(author, kind, value, number, shape):
    values = read_array(author(kind, value), "a", NOW, number, shape)
    assert values.dtype == number
    assert values.shape == (len(value), *shape)


def test_an_attribute_without_a_value_has_none(stage):
    prim = stage.DefinePrim("/P")
    assert read_array(prim, "a", NOW, np.float64, (3,)).shape == (0, 3)
    assert read_texts(prim, "a") == ()


@pytest.mark.parametrize(
    ("kind", "value", "number", "shape", "message"),
    [
        (TYPES.Float4Array, [(1, 2, 3, 4)], np.float64, (3,), "a is of type float4[]; float3[] is needed"),
        (TYPES.IntArray, [1], np.float64, (), "a is of type int[]; float[] is needed"),
        (TYPES.Float3, (1, 2, 3), np.float64, (), "a is of type float3; float[] is needed"),
        (TYPES.Matrix4d, Gf.Matrix4d(1), np.float64, (4,), "a is of type matrix4d; quatf[] is needed"),
        (TYPES.FloatArray, [1.0], np.intp, (), "a is of type float[]; int[] is needed"),
        (TYPES.BoolArray, [True], np.intp, (), "a is of type bool[]; int[] is needed"),
        (TYPES.StringArray, ["1"], np.intp, (), "a is of type string[]; int[] is needed"),
        (TYPES.Float2Array, [(0, 0), (0, np.nan)], np.float64, (2,), "a[1] is nan; a number within +-1e+18 is needed"),
        (TYPES.DoubleArray, [0, 0, -1e19], np.float64, (), "a[2] is -1e+19; a number within +-1e+18 is needed"),
        (TYPES.Matrix4dArray, [BROKEN], np.float64, (4, 4), "a[0] is inf; a number within +-1e+18 is needed"),
    ],
)
def test_arrays_of_other_types_and_numbers_are_named(author, kind, value, number, shape, message):
    with pytest.raises(AssetError, match=f"^{re.escape(f'/P: {message}')}$"):
        read_array(author(kind, value), "a", NOW, number, shape)


def token(prim):
    return read_token(prim, "a", NOW, ("one",))


def number(prim, *least):
    return read_number(prim, "a", NOW, *least)


@pytest.mark.parametrize(
    ("read", "kind", "value", "message"),
    [
        (lambda prim: number(prim, 0.0), TYPES.Double, -1.0, r"a is -1; a number from 0 to 1e\+18"),
        (number, TYPES.Float, np.nan, r"a is nan; a number from -1e\+18 to"),
        (number, TYPES.Bool, True, "a is of type bool; double is needed"),
        (lambda prim: read_number(prim, "b", NOW), TYPES.Bool, True, "b is empty; double is needed"),
        (token, TYPES.Token, "two", r"a is 'two' \(known: one\)"),
        (token, TYPES.Token, "\x1b[2J", r"a is '\\x1b\[2J' \(known: one\)"),
        (token, TYPES.Token, "x" * 999, "a is 'x{60}…'"),
        (token, TYPES.Int, 1, "a is of type int; token is needed"),
        (lambda prim: read_texts(prim, "a"), TYPES.Token, "one", r"a is of type string; token\[\] is needed"),
        (lambda prim: read_matrix(prim, "a", NOW), TYPES.Double, 1.0, "a is of type double; matrix4d is needed"),
        (lambda prim: read_matrix(prim, "a", NOW), TYPES.Matrix4d, BROKEN, r"a\[0\] is inf"),
    ],
)
def test_single_values_are_checked(author, read, kind, value, message):
    with pytest.raises(AssetError, match=f"^/P: {message}"):
        read(author(kind, value))


def test_a_value_of_another_type_than_its_attribute_is_named(stage, author):
    """A stronger layer declares the type, a weaker one has a value of another."""
    weaker = Sdf.Layer.CreateAnonymous(".usda")
    weaker.ImportFromString('#usda 1.0\nover "P"\n{\n    custom string a = "word"\n}')
    prim = author(TYPES.FloatArray, Vt.FloatArray())
    prim.GetAttribute("a").Clear()
    stage.GetRootLayer().subLayerPaths.append(weaker.identifier)
    with pytest.raises(AssetError, match=r"^/P: a is of type string; float\[\] is needed"):
        read_array(prim, "a", NOW, np.float64)
