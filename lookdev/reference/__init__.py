"""The reference renderer: image values in float64 NumPy, to compare Cycles with."""
