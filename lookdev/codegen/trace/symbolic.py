"""Symbolic arrays: the values of textured parameters and of directions while a model is traced.

A `SymbolicArray` implements ``__array_ufunc__`` (NEP 13) and ``__array_function__`` (NEP 18), so the NumPy code of a
model runs on it unchanged. If all elements of a result fold to constants, the result is an ordinary array, or a
`UniformArray` where some constants are uniforms.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from lookdev.brdf.table import Table, look_up
from lookdev.codegen.trace.graph import OPERATIONS, Graph, Node, Uniform, uniform
from lookdev.errors import CodegenError


class SymbolicArray(NDArrayOperatorsMixin):
    """An array whose elements are nodes of one expression graph, or constants."""

    def __init__(self, graph: Graph, elements: NDArray[np.object_]) -> None:
        self.graph = graph
        self.elements = elements

    @property
    def shape(self) -> tuple[int, ...]:
        return self.elements.shape

    @property
    def ndim(self) -> int:
        return self.elements.ndim

    def __getitem__(self, index: Any) -> Any:
        return _wrap(self.graph, self.elements[index])

    def sum(self, axis: int) -> Any:
        return _sum(self.graph, self, axis)

    def __bool__(self) -> bool:
        raise CodegenError("a model branches on a value known only at run time; use numpy.where")

    def __array__(self, dtype: Any = None) -> Any:
        raise CodegenError("a model converts a value known only at run time to numbers; use ufuncs")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        if method != "__call__" or kwargs:
            raise CodegenError(f"a model uses numpy.{ufunc.__name__}.{method} with {sorted(kwargs)}; plain calls only")
        return _elementwise(self.graph, ufunc.__name__, *inputs)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if func not in _FUNCTIONS:
            supported = ", ".join(sorted(function.__name__ for function in _FUNCTIONS))
            raise CodegenError(
                f"a model uses numpy.{func.__name__}, which symbolic arrays lack; they have: {supported}"
            )
        return _FUNCTIONS[func](self.graph, *args, **kwargs)


class UniformArray(np.ndarray[Any, Any]):
    """An ordinary array of constants, some of which are uniforms; operations that are not traced lose these."""

    graph: Graph
    elements: NDArray[np.object_] | None = None

    def __getitem__(self, index: Any) -> Any:
        return super().__getitem__(index) if self.elements is None else _wrap(self.graph, self.elements[index])

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        if any(isinstance(value, SymbolicArray) for value in inputs):
            return NotImplemented
        if method != "__call__" or kwargs or ufunc.__name__ not in OPERATIONS:
            return getattr(ufunc, method)(*map(_plain, inputs), **kwargs)
        return _elementwise(self.graph, ufunc.__name__, *inputs)

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        if SymbolicArray in types:
            return NotImplemented
        if func in _FUNCTIONS:
            return _FUNCTIONS[func](self.graph, *args, **kwargs)
        return func(*map(_plain, args), **kwargs)


def uniforms(graph: Graph, value: Any) -> Any:
    """Return an array of floats whose elements are `uniform` numbers."""
    elements: Callable[..., Any] = np.frompyfunc(uniform, 1, 1)
    return _wrap(graph, elements(np.asarray(value).astype(object)))


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return type(value)(map(_plain, value))
    return value.view(np.ndarray) if isinstance(value, UniformArray) else value


def symbols(graph: Graph, names: Sequence[str]) -> SymbolicArray:
    """Return a vector of named symbols, shape (len(names),)."""
    return SymbolicArray(graph, np.array([graph.symbol(name) for name in names], dtype=object))


def symbol(graph: Graph, name: str) -> SymbolicArray:
    """Return one named symbol, shape ()."""
    return SymbolicArray(graph, np.array(graph.symbol(name), dtype=object))


def elements_of(value: Any) -> list[Any]:
    """Return the nodes and constants of a symbolic or ordinary array, flat."""
    return list(_elements(value).ravel())


def _elements(value: Any) -> NDArray[np.object_]:
    if isinstance(value, SymbolicArray | UniformArray) and value.elements is not None:
        return value.elements
    return np.asarray(value).astype(object)


def _wrap(graph: Graph, elements: Any) -> Any:
    """Return elements as a symbolic array, or as an ordinary or uniform array if all are constants."""
    array = np.asarray(elements, dtype=object)
    if any(isinstance(element, Node) for element in array.ravel()):
        return SymbolicArray(graph, array)
    constants = np.array(array.tolist())
    if any(isinstance(element, Uniform) for element in array.ravel()):
        uniform_array = constants.view(UniformArray)
        uniform_array.graph, uniform_array.elements = graph, array
        return uniform_array
    return constants


def _elementwise(graph: Graph, op: str, *inputs: Any) -> Any:
    function: Callable[..., Any] = np.frompyfunc(lambda *args: graph.apply(op, *args), len(inputs), 1)
    return _wrap(graph, function(*(_elements(value) for value in inputs)))


def _sum(graph: Graph, a: Any, axis: int) -> Any:
    if axis != -1:
        raise CodegenError(f"a model sums over axis {axis}; only the last axis has a generated counterpart")
    return _wrap(graph, np.frompyfunc(lambda x, y: graph.apply("add", x, y), 2, 1).reduce(_elements(a), axis=-1))


def _stack(graph: Graph, arrays: Sequence[Any], axis: int = 0) -> Any:
    return _wrap(graph, np.stack([_elements(array) for array in arrays], axis=axis))


def _expand_dims(graph: Graph, a: Any, axis: int) -> Any:
    return _wrap(graph, np.expand_dims(_elements(a), axis))


def _where(graph: Graph, condition: Any, x: Any, y: Any) -> Any:
    return _elementwise(graph, "where", condition, x, y)


def _clip(graph: Graph, a: Any, a_min: Any, a_max: Any) -> Any:
    return _elementwise(graph, "minimum", _elementwise(graph, "maximum", a, a_min), a_max)


def _moveaxis(graph: Graph, a: Any, source: int, destination: int) -> Any:
    return _wrap(graph, np.moveaxis(_elements(a), source, destination))


def _broadcast_arrays(graph: Graph, *arrays: Any) -> list[Any]:
    return [_wrap(graph, array) for array in np.broadcast_arrays(*map(_elements, arrays))]


def _look_up(graph: Graph, table: Table, row: Any, column: Any) -> Any:
    def channel(number: int | None) -> Any:
        function = np.frompyfunc(lambda *cell: graph.look_up(table, number, *cell), 2, 1)
        return _wrap(graph, function(_elements(row), _elements(column)))

    return channel(None) if table.values.ndim == 2 else _stack(graph, [channel(i) for i in range(3)], axis=-1)


_FUNCTIONS: dict[Any, Callable[..., Any]]
_FUNCTIONS = {
    np.sum: _sum,
    np.stack: _stack,
    np.expand_dims: _expand_dims,
    np.where: _where,
    np.clip: _clip,
    np.moveaxis: _moveaxis,
    np.broadcast_arrays: _broadcast_arrays,
    look_up: _look_up,
    np.zeros_like: lambda graph, a: np.zeros(a.shape),
    np.ones_like: lambda graph, a: np.ones(a.shape),
}
