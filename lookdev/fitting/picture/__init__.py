"""Parameters of a look found in a picture of it, by derivatives of renders.

`photo` reads the picture and its noise, `unknowns` has what is searched, `target` compares renders with the picture,
`search` is the optimisation, `page` the report. Renders come from a function: who renders is not known here.
"""

from lookdev.fitting.picture.photo import Photo, read_photo
from lookdev.fitting.picture.search import Found, Search, Settings
from lookdev.fitting.picture.target import Target
from lookdev.fitting.picture.unknowns import Unknown, unknowns_of

__all__ = ["Found", "Photo", "Search", "Settings", "Target", "Unknown", "read_photo", "unknowns_of"]
