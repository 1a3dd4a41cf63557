"""The checks of `lookdev check`: models and looks in Cycles against float64 NumPy, and the commands' evaluations."""
