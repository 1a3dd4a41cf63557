"""Plots of reflectance: models, looks, presets and measured files, over one another (Burley 2012, section 3.2).

`read_subject` parses the subject of a plot. `KINDS` has the kinds of plots: functions of subjects that return a `Plot`,
a matplotlib figure and its numbers, which `Plot.write` writes. All numbers come from the float64 models.
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
