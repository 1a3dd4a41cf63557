"""Write traced looks and lights as programs: lists of operations, for Mitsuba, GLSL and evaluation by NumPy."""
