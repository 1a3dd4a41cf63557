"""Parameters of a look found in a picture of it, by derivatives of renders.

`photo` reads the picture and its noise, `unknowns` has what is searched, `target` compares renders with the picture,
`search` is the optimisation, `page` the report. Renders come from a function: who renders is not known here.
"""

from lookdev.fit.picture.photo import Photo, read_photo
from lookdev.fit.picture.search import Found, Search, Settings
from lookdev.fit.picture.target import Target
from lookdev.fit.picture.unknowns import Unknown, unknowns_of

__all__ = ["Found", "Photo", "Search", "Settings", "Target", "Unknown", "read_photo", "unknowns_of"]
