"""Arrays of symbols: the NumPy code of a model runs on them unchanged, and thereby builds an expression graph.

While a model is traced, each direction and each textured parameter is a `SymbolicArray`. This class implements
``__array_ufunc__`` (NEP 13) and ``__array_function__`` (NEP 18). If all elements of a result fold to constants, the
result is an ordinary array. If some of these constants are numbers of a look to which generated code refers by name
(`Uniform`), the result is a `UniformArray`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from lookdev.arrays import Floats
from lookdev.brdf.table import NumberTable, look_up
from lookdev.brdf.vectors import Array, BooleanArray, Index
from lookdev.codegen.trace.graph import OPERATIONS, Graph, GraphNode, Scalar, Uniform, uniform
from lookdev.errors import CodegenError

SymbolicLike: TypeAlias = "Array | BooleanArray | Sequence[Array | BooleanArray | Scalar] | Scalar"
"""An array, symbolic or not, or a value that can become one."""

TracedFunction: TypeAlias = Callable[..., object]
"""A function of NumPy, or `look_up`."""


class SymbolicArray(NDArrayOperatorsMixin):
    """An array whose `elements` are nodes of one expression graph, or constants."""

    def __init__(self, graph: Graph, elements: NDArray[np.object_]) -> None:
        self.graph = graph
        self.elements = elements

    @property
    def shape(self) -> tuple[int, ...]:
        return self.elements.shape

    @property
    def ndim(self) -> int:
        return self.elements.ndim

    def __getitem__(self, index: Index) -> Array:
        return _wrap(self.graph, self.elements[index])

    def sum(self, axis: int) -> Array:
        return _sum(self.graph, self, axis)

    def __bool__(self) -> bool:
        raise CodegenError("a model branches on a value known only at run time; use numpy.where")

    def __array__(self, dtype: None = None) -> Floats:
        raise CodegenError("a model converts a value known only at run time to numbers; use ufuncs")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **kwargs: object) -> Array:
        if method != "__call__" or kwargs:
            raise CodegenError(f"a model uses numpy.{ufunc.__name__}.{method} with {sorted(kwargs)}; plain calls only")
        return _elementwise(self.graph, ufunc.__name__, *inputs)

    def __array_function__(
        self, func: TracedFunction, types: Iterable[type], args: Iterable[object], kwargs: Mapping[str, object]
    ) -> object:
        if func not in _FUNCTIONS:
            supported = ", ".join(sorted(function.__name__ for function in _FUNCTIONS))
            raise CodegenError(
                f"a model uses numpy.{func.__name__}, which symbolic arrays lack; they have: {supported}"
            )
        return _FUNCTIONS[func](self.graph, *args, **kwargs)


class UniformArray(np.ndarray[tuple[int, ...], np.dtype[np.float64]]):
    """An array of constants, some of which are uniforms (`Uniform`).

    `elements` has the same constants as Python objects, so that a `Uniform` can be told from other floats. The results
    of the operations in `OPERATIONS` have uniforms, too. Other operations return ordinary arrays, without uniforms.
    """

    graph: Graph
    elements: NDArray[np.object_] | None = None

    def __getitem__(self, index: Any) -> Any:
        return super().__getitem__(index) if self.elements is None else _wrap(self.graph, self.elements[index])

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: object, **kwargs: object) -> object:
        if any(isinstance(value, SymbolicArray) for value in inputs):
            return NotImplemented
        if method != "__call__" or kwargs or ufunc.__name__ not in OPERATIONS:
            return getattr(ufunc, method)(*map(_plain_value, inputs), **kwargs)
        return _elementwise(self.graph, ufunc.__name__, *inputs)

    def __array_function__(
        self, func: TracedFunction, types: Iterable[type], args: Iterable[object], kwargs: Mapping[str, object]
    ) -> object:
        if SymbolicArray in types:
            return NotImplemented
        if func in _FUNCTIONS:
            return _FUNCTIONS[func](self.graph, *args, **kwargs)
        return func(*map(_plain_value, args), **kwargs)


def uniforms(graph: Graph, value: SymbolicLike) -> Array:
    """Convert each element of an array to a uniform, by the function `uniform`, and return the array."""
    elements = np.frompyfunc(uniform, 1, 1)
    return _wrap(graph, elements(np.asarray(value).astype(object)))


def _plain_value(value: object) -> object:
    """Return an argument of a NumPy function with ordinary arrays in place of uniform arrays."""
    if isinstance(value, list | tuple):
        return type(value)(map(_plain_value, value))
    return value.view(np.ndarray) if isinstance(value, UniformArray) else value


def symbols(graph: Graph, names: Sequence[str]) -> SymbolicArray:
    """Return a vector of named symbols, shape (len(names),)."""
    return SymbolicArray(graph, np.array([graph.symbol(name) for name in names], dtype=object))


def vector_symbols(graph: Graph, name: str) -> SymbolicArray:
    """Return the symbols ``name[0]`` to ``name[2]``, shape (3,)."""
    return symbols(graph, [f"{name}[{i}]" for i in range(3)])


def symbol(graph: Graph, name: str) -> SymbolicArray:
    """Return one named symbol, shape ()."""
    return SymbolicArray(graph, np.array(graph.symbol(name), dtype=object))


def elements_of(value: SymbolicLike) -> list[Scalar]:
    """Return the elements of a symbolic or ordinary array as a flat list of nodes and constants."""
    return list(_elements(value).ravel())


def _elements(value: object) -> NDArray[np.object_]:
    """Return the elements of a symbolic or ordinary array, as an array of objects of the same shape."""
    if isinstance(value, SymbolicArray | UniformArray) and value.elements is not None:
        return value.elements
    return np.asarray(value).astype(object)


def _wrap(graph: Graph, elements: object) -> Array:
    """Return an array of elements: symbolic, or an ordinary or uniform one if all elements are constants."""
    array = np.asarray(elements, dtype=object)
    if any(isinstance(element, GraphNode) for element in array.ravel()):
        return SymbolicArray(graph, array)
    constants = np.array(array.tolist())
    if any(isinstance(element, Uniform) for element in array.ravel()):
        uniform_array = constants.view(UniformArray)
        uniform_array.graph, uniform_array.elements = graph, array
        return uniform_array
    return constants


# The functions below replace those of NumPy that a model may call.


def _elementwise(graph: Graph, op: str, *inputs: object) -> Array:
    """Apply an operation of the graph to arrays, element by element; the arrays are broadcast."""
    function = np.frompyfunc(lambda *args: graph.apply(op, *args), len(inputs), 1)
    return _wrap(graph, function(*(_elements(value) for value in inputs)))


def _sum(graph: Graph, a: object, axis: int) -> Array:
    if axis != -1:
        raise CodegenError(f"a model sums over axis {axis}; only the last axis has a generated counterpart")
    return _wrap(graph, np.frompyfunc(lambda x, y: graph.apply("add", x, y), 2, 1).reduce(_elements(a), axis=-1))


def _stack(graph: Graph, arrays: Sequence[object], axis: int = 0) -> Array:
    return _wrap(graph, np.stack([_elements(array) for array in arrays], axis=axis))


def _clip(graph: Graph, a: object, a_min: object, a_max: object) -> Array:
    return _elementwise(graph, "minimum", _elementwise(graph, "maximum", a, a_min), a_max)


def _reshape_function(function: Callable[..., NDArray[np.object_]]) -> Callable[..., Array]:
    """Return the counterpart of a function of NumPy that only moves the elements of its first argument."""
    return lambda graph, a, *args, **kwargs: _wrap(graph, function(_elements(a), *args, **kwargs))


def _broadcast_arrays(graph: Graph, *arrays: object) -> list[Array]:
    return [_wrap(graph, array) for array in np.broadcast_arrays(*map(_elements, arrays))]


def _look_up(graph: Graph, table: NumberTable, row: object, column: object) -> Array:
    """Return what `lookdev.brdf.table.look_up` returns, for rows and columns that may be symbolic."""

    def channel(number: int | None) -> Array:
        """Return channel `number` of cells that are colours, or with None the numbers of other cells."""
        function = np.frompyfunc(lambda *cell: graph.look_up(table, number, *cell), 2, 1)
        return _wrap(graph, function(_elements(row), _elements(column)))

    return channel(None) if table.values.ndim == 2 else _stack(graph, [channel(i) for i in range(3)], axis=-1)


_FUNCTIONS: dict[TracedFunction, Callable[..., object]] = {
    np.sum: _sum,
    np.stack: _stack,
    np.expand_dims: _reshape_function(np.expand_dims),
    np.where: lambda graph, *args: _elementwise(graph, "where", *args),
    np.clip: _clip,
    np.moveaxis: _reshape_function(np.moveaxis),
    np.broadcast_arrays: _broadcast_arrays,
    look_up: _look_up,
    np.zeros_like: lambda graph, a: np.zeros(a.shape),
    np.ones_like: lambda graph, a: np.ones(a.shape),
}
