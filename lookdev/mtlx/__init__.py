"""Converts MaterialX documents to USD layers, so that a reference to `x.mtlx` composes like a reference to a USD file.

The wheels of USD lack USD's plugin for MaterialX. Therefore `shade` converts a document to a cached USD layer, with the
same structure as the plugin's layer, and `arcs` redirects arcs from the document to that layer. `document` reads and
checks a document.
"""

from lookdev.mtlx.arcs import is_document, redirect_documents
from lookdev.mtlx.document import library_inputs, read_document
from lookdev.mtlx.shade import NOTES_KEY, document_layer

__all__ = ["NOTES_KEY", "document_layer", "is_document", "library_inputs", "read_document", "redirect_documents"]
