"""MaterialX documents as USD: what an asset refers to as `x.mtlx` composes like any other layer.

The wheels of USD lack its plugin for MaterialX. So a document becomes a USD layer of the same structure (`shade`), in
the cache, and the arcs to it are redirected in memory (`arcs`).
"""

from lookdev.mtlx.arcs import is_document, redirect
from lookdev.mtlx.document import read_document
from lookdev.mtlx.shade import NOTES, document_layer

__all__ = ["NOTES", "document_layer", "is_document", "read_document", "redirect"]
