"""Reads MaterialX documents from untrusted XML.

The XML is checked before the MaterialX package reads it, because the package silently drops includes and siblings of
equal names. A document is not upgraded to the package's version, since an upgrade takes minutes for a megabyte of
nodes.
"""

from __future__ import annotations

import re
from functools import cache
from xml.parsers import expat

import MaterialX as mx

from lookdev.errors import Fault, LookError
from lookdev.safe_text import TextError, decode

INVALID_IMAGE_PATH = re.compile(r"[\x00-\x1f\x7f-\x9f{]|<(?!UDIM>)")
"""Matches the parts of an image's path that are not allowed: control characters, and tokens other than <UDIM>."""

# The versions that are read: from 1.38, the first with a disney_principled node, to the MaterialX package's.
_FIRST_VERSION, _LAST_VERSION = (1, 38), tuple(mx.getVersionIntegers()[:2])
_MAX_DEPTH = 32  # levels of nested elements
_VERSION = re.compile(r"(\d{1,4})\.(\d{1,4})")


def read_document(data: bytes, file: str) -> tuple[mx.Document, tuple[Fault, ...]]:
    """Return a MaterialX document and a fault for each of its includes, since includes are not followed.

    `data` is the content of the document, and `file` its path for messages.

    Raises
    ------
    LookError
        The data is not a MaterialX document of a known version.
    """
    try:
        text = decode(data, file)
    except TextError as error:
        raise LookError(error.faults) from None
    includes = _check_xml(text, file)
    document = mx.createDocument()
    options = mx.XmlReadOptions()
    options.readXIncludeFunction = None
    options.upgradeVersion = False
    try:
        mx.readFromXmlString(document, text, mx.FileSearchPath(), options)
    except (mx.Exception, mx.ExceptionParseError) as error:
        raise LookError([Fault(file, "", f"MaterialX cannot read it: {error}")]) from error
    return document, includes


def _check_xml(text: str, file: str) -> tuple[Fault, ...]:
    """Raise LookError for a document that is malformed or would exhaust a parser; return a fault for each include."""
    names: list[set[str]] = []  # for each open element, the names of its children so far
    includes: list[Fault] = []
    parser = expat.ParserCreate("utf-8")

    def fault_here(message: str, hint: str = "") -> Fault:
        """Return a fault at the parser's present location."""
        return Fault(file, f"line {parser.CurrentLineNumber}, column {parser.CurrentColumnNumber + 1}", message, hint)

    def check_root(tag: str, version: str) -> None:
        """Raise LookError unless the root element is a MaterialX document of a version that can be read."""
        if tag != "materialx":
            raise LookError([fault_here(f"the document is <{tag:.40}>, not <materialx>")])
        match = _VERSION.fullmatch(version)
        if not match or not _FIRST_VERSION <= (int(match[1]), int(match[2])) <= _LAST_VERSION:
            (a, b), (c, d) = _FIRST_VERSION, _LAST_VERSION
            raise LookError([fault_here(f"MaterialX version '{version:.40}'", f"{a}.{b} to {c}.{d} can be read")])

    def start_element(tag: str, attributes: dict[str, str]) -> None:
        """Check an element when the parser reads its start tag."""
        name = attributes.get("name", "")
        if not names:
            check_root(tag, attributes.get("version", ""))
        if len(names) == _MAX_DEPTH:
            raise LookError([fault_here(f"more than {_MAX_DEPTH} elements inside each other")])
        if tag == "xi:include":
            includes.append(fault_here(f"includes '{attributes.get('href', ''):.80}'", "includes are not followed"))
        if name and names and name in names[-1]:
            raise LookError([fault_here(f"a second element here is named '{name:.40}'", "names are unique")])
        if names:
            names[-1].add(name)
        names.append(set())

    def reject_doctype(*_: object) -> None:
        raise LookError([fault_here("has a document type definition", "remove <!DOCTYPE>")])

    parser.StartElementHandler, parser.EndElementHandler = start_element, lambda tag: names.pop()
    parser.StartDoctypeDeclHandler = reject_doctype
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        where = f"line {error.lineno}, column {error.offset + 1}"
        raise LookError([Fault(file, where, f"is not XML: {expat.ErrorString(error.code)}")]) from error
    return tuple(includes)


@cache
def library_inputs(file: str, definition: str) -> dict[str, mx.Input]:
    """Return the inputs of a surface shader in the MaterialX library, by name.

    `definition` is the name of its node definition, in ``libraries/bxdf/<file>.mtlx``.
    """
    library = mx.createDocument()
    mx.readFromXmlFile(library, mx.getDefaultDataSearchPath().find(f"libraries/bxdf/{file}.mtlx"))
    return {port.getName(): port for port in library.getNodeDef(definition).getActiveInputs()}
