"""The reference renderer: pixel values (`render`) and albedos (`albedo`) in float64 NumPy, to compare Cycles with."""
