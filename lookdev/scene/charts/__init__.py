"""Reference props beside the asset in a frame: a chrome ball, a grey ball and a colour chart.

They are rendered in a scene of their own. `colorchecker` has the chart's published colours. `props` has the positions
of the props in the frame, and makes their scene.
"""
