"""Reference props beside the asset: a chrome ball, a grey ball and a colour chart, in a separate scene.

`colorchecker` has the chart's published colours, `props` the positions of the props in the frame, and their scene.
"""
