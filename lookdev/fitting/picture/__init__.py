"""`lookdev fit --picture`: fits parameters of a look to a picture of the look, by derivatives of renders.

- `fit`: the command, from the request to the files it writes
- `photo`: reads the picture, and its noise
- `unknowns`: the parameters that are searched, within bounds
- `live_frame`: renders the job's frame, and its derivatives with respect to the unknowns
- `target`: compares renders with the picture
- `search`: the optimisation, which does not depend on a renderer
- `page`: the report
"""
