"""The fit of a model's parameters to f of any subject of a plot: measured data, a look, another model.

`data` has the pairs of directions and the losses, `parameters` the choice and scaling of the fitted parameters, `solve`
the search.
"""

from lookdev.fitting.data import LOSSES
from lookdev.fitting.parameters import Free, free_parameters
from lookdev.fitting.solve import Fit, fit, format_fit

__all__ = ["LOSSES", "Fit", "Free", "fit", "format_fit", "free_parameters"]
