"""Symbolic arrays, and the expression graph that a model builds when it is called with them."""
