"""The fit of a look's parameters to a picture of it, by derivatives of renders.

`photo` reads the picture and its noise, `unknowns` has the parameters that are searched, `target` compares renders with
the picture, `search` is the optimisation, `page` the report. A function supplies the renders, so these modules do not
depend on a renderer.
"""
