"""`lookdev fit`: fits the parameters of a reflectance model to measured data, to a look, or to another model.

- `data`: the pairs of directions at which the BRDFs are compared, and the losses
- `parameters`: the parameters that are fitted, and their scaling
- `solve`: the search
- `picture`: another fit, of a look's parameters to a picture of the look
"""

from lookdev.fitting.solve import fit_model, format_fit

__all__ = ["fit_model", "format_fit"]
