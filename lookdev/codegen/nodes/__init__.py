"""Shader nodes of Blender from traced models, as plain data."""
