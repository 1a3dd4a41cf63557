"""The second renderer: the models as published in Mitsuba 3 (Jakob et al. 2022), whose kernels Dr.Jit compiles.

A process of its own, ``python -m lookdev.mitsuba``, of the same protocol as `lookdev.cycles`. Of Mitsuba it uses the
scene that rays meet; shading, lights and the estimator are programs of this package, traced by Dr.Jit.
"""
