"""The fit of a model's parameters to f of any subject of a plot: measured data, a look, another model.

`data` has the pairs of directions and the losses, `parameters` the choice and scaling of the fitted parameters, `solve`
the search.
"""

from lookdev.fitting.solve import fit_model, format_fit

__all__ = ["fit_model", "format_fit"]
