"""Plots of reflectance: models, looks, presets and measured files, over one another (Burley 2012, section 3.2).

`read_subject` understands what to plot, `KINDS` are the plots, functions from subjects to a `Plot`: a matplotlib figure
and the numbers it shows, which `Plot.write` writes. All numbers are those of the float64 models.
"""

from lookdev.plotting.figure import SUFFIXES, Plot
from lookdev.plotting.kinds import KINDS, Kind, draw, kind_named
from lookdev.plotting.options import Options
from lookdev.plotting.subject import Subject, read_subject, subject_of

__all__ = [
    "KINDS",
    "SUFFIXES",
    "Kind",
    "Options",
    "Plot",
    "Subject",
    "draw",
    "kind_named",
    "read_subject",
    "subject_of",
]
