"""Looks as programs: lists of operations, which Dr.Jit traces into kernels (Jakob et al. 2022)."""
