"""MaterialX documents as USD layers: a reference to `x.mtlx` composes as one to any other layer.

The wheels of USD lack its plugin for MaterialX. So `shade` converts a document to a cached USD layer of the same
structure, and `arcs` redirects the arcs to the document in memory.
"""

from lookdev.mtlx.arcs import is_document, redirect_documents
from lookdev.mtlx.document import library_inputs, read_document
from lookdev.mtlx.shade import NOTES_KEY, document_layer

__all__ = ["NOTES_KEY", "document_layer", "is_document", "library_inputs", "read_document", "redirect_documents"]
