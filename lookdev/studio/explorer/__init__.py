"""The Explorer, the page of `lookdev explore`: interactive plots of surfaces, side by side (Burley 2012, section 3.2).

A surface is a model with parameters, a preset, a look or measured data. `surfaces` reads surfaces from text, as on the
command line, and computes their plots. `catalogue` lists what a user can choose on the page. `shading` generates the
GLSL with which the page draws spheres and lobes, and reference values for it. `frames` renders the exact picture. `usd`
writes a surface as USD. `channel` answers the messages of a page, `app` has the routes, and `run` serves them. The
state of a page is in its URL alone.
"""
