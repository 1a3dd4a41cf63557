"""Traced graphs as programs: lists of operations, plain data for targets that need no text of a look's own."""
