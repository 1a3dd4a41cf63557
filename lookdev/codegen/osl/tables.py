"""Tables that a model looks up, as parameters of a shader, and the files that have their values."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR

from lookdev.brdf.table import Table
from lookdev.cache import Content, cached_file, from_memory
from lookdev.codegen.osl.block import fits_array, table_name, texture_size
from lookdev.codegen.source import TableBinding


@dataclass(frozen=True)
class BoundTables:
    """The lines that declare tables as parameters of a shader, and the bindings of these parameters to files."""

    parameters: tuple[str, ...]
    bindings: tuple[TableBinding, ...]


def bind_tables(tables: Iterable[Table]) -> BoundTables:
    """Put tables into the store, each once, and bind them to parameters.

    Raises
    ------
    OutputError
        A table cannot be stored.
    """
    parameters, bindings = [], []
    for table in tables:
        name = table_name(table)
        array, path = f"float {name}[{table.values.size}] = {{0}}", f'string {name} = ""'
        parameters.append(f"    {array if fits_array(table) else path},")
        bindings.append(TableBinding(name, _store_table(table)))
    return BoundTables(tuple(parameters), tuple(bindings))


def _store_table(table: Table) -> Content:
    """Put the values of a table into the store, as the array or the texture that a shader reads."""

    def save(path: Path) -> None:
        np.save(path, np.asarray(table.values, np.float32).ravel())

    def paint(path: Path) -> None:
        width, height = texture_size(table)
        image = np.zeros((height, width, 3), np.float32)
        image[: table.values.shape[0], : table.values.shape[1]] = table.values.reshape(*table.values.shape[:2], -1)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": image}) as exr, from_memory(path) as name:
            exr.write(name)

    suffix, write = (".npy", save) if fits_array(table) else (".exr", paint)
    return cached_file("tables", table.digest + suffix, suffix, write)
