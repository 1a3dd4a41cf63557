"""Explorer: models, looks and measured data side by side, by plots that follow the hand (Burley 2012, section 3.2).

`surfaces` has what is plotted, by the words of the command line, and its numbers; `catalogue` what there is to plot;
`shading` the GLSL by which the page draws spheres and lobes, and what it is compared with; `frames` the renderer's own
picture; `channel` the page's messages; `app` the routes. The state of a page is in its URL alone.
"""
