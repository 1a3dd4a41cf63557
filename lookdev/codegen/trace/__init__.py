"""Symbolic arrays and the expression graph that a model leaves behind."""
