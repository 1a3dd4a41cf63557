"""Parameters of a model fitted to f of anything that can be plotted: measured data, a look, another model.

`data` has the pairs of directions, `loss` how values are compared, `parameters` which are fitted and how they are
scaled, `solve` the search.
"""

from lookdev.fitting.loss import LOSSES
from lookdev.fitting.parameters import Free, free_parameters
from lookdev.fitting.solve import Fit, fit, fit_text

__all__ = ["LOSSES", "Fit", "Free", "fit", "fit_text", "free_parameters"]
