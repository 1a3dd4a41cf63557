"""Traced graphs as programs: lists of operations, plain data for targets that compile no text for a look."""
