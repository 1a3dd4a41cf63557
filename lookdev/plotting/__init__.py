"""Plots of reflectance: models, looks, presets and measured data in one plot (Burley 2012, section 3.2).

`read_subject` reads a subject, which is a surface to plot, from a text of the command line. `KINDS` lists the kinds of
plots. `draw` returns a `Plot` of subjects: a matplotlib figure and its numbers, which `Plot.write` writes to a file.
All numbers are computed by the float64 models.

In this package, f is the BSDF, `wo` and `wi` are unit directions to the viewer and to the light, in a frame whose z is
the normal, and theta and phi are polar angle and azimuth in this frame. theta_h is the polar angle of the half vector;
theta_d and phi_d are the angles of the difference vector (Rusinkiewicz 1998).
"""

from lookdev.plotting.figure import PLOT_SUFFIXES, Plot
from lookdev.plotting.kinds import KINDS, draw, kind_named
from lookdev.plotting.options import PlotOptions
from lookdev.plotting.subject import PlotSubject, model_subject, read_subject

__all__ = [
    "KINDS",
    "PLOT_SUFFIXES",
    "Plot",
    "PlotOptions",
    "PlotSubject",
    "draw",
    "kind_named",
    "model_subject",
    "read_subject",
]
