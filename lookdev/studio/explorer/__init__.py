"""The Explorer: interactive plots of models, looks and measured data, side by side (Burley 2012, section 3.2).

`surfaces` reads surfaces from the text of the command line and computes their plots; `catalogue` lists what the page
offers; `shading` generates the GLSL with which the page draws spheres and lobes, and reference values for it; `frames`
renders the exact picture; `channel` handles the messages of a page; `app` has the routes. The state of a page is in its
URL alone.
"""
