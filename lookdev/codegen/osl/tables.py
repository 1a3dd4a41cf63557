"""Bind tables of measured data to the parameters of a shader: as arrays, or as textures if they are large."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import OpenEXR

from lookdev.brdf.table import NumberTable
from lookdev.cache import Content, cached_file, memory_file
from lookdev.codegen.osl.block import fits_array, table_name, texture_size
from lookdev.codegen.program.look import store_table
from lookdev.codegen.source import TableBinding


def bind_tables(tables: Iterable[NumberTable]) -> tuple[list[str], tuple[TableBinding, ...]]:
    """Store the files of tables; return the lines that declare the shader's parameters for tables, and the bindings.

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
    return parameters, tuple(bindings)


def _store_table(table: NumberTable) -> Content:
    """Store a table as the file that a shader reads: an array if `fits_array`, else a texture."""

    if fits_array(table):
        return store_table(table)

    def write_texture(path: Path) -> None:
        width, height = texture_size(table)
        image = np.zeros((height, width, 3), np.float32)
        image[: table.values.shape[0], : table.values.shape[1]] = table.values.reshape(*table.values.shape[:2], -1)
        header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
        with OpenEXR.File(header, {"RGB": image}) as exr, memory_file(path) as name:
            exr.write(name)

    return cached_file("tables", f"{table.digest}.exr", ".exr", write_texture)
