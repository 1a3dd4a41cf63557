"""The fit of a look's parameters to a picture of it, by derivatives of renders.

`photo` reads the picture and its noise, `unknowns` has the parameters that are searched, `target` compares renders with
the picture, `search` is the optimisation, `page` the report. A function supplies the renders, so these modules do not
depend on a renderer.
"""

from lookdev.fitting.picture.photo import Photo, read_photo
from lookdev.fitting.picture.search import Found, Search, Settings
from lookdev.fitting.picture.target import Target
from lookdev.fitting.picture.unknowns import Unknown, parse_unknowns

__all__ = ["Found", "Photo", "Search", "Settings", "Target", "Unknown", "parse_unknowns", "read_photo"]
