"""Trace the reflectance models: called with symbolic arrays, a model builds an expression graph instead of numbers."""
