"""The review page: one static folder that a browser opens from disk, without server and network.

A page from ``file://`` may run scripts and show pictures, and read nothing else: `fetch` is forbidden, and a canvas
with a picture of another file cannot be read. So all numbers are in scripts (`pixels`), and OpenColorIO's view is a
shader (`view`). The page's own files are in ``static``.
"""

from lookdev.output.review.compare import Comparison, compare_frames
from lookdev.output.review.page import Reel, ReviewFrame, Version, write_page

__all__ = ["Comparison", "Reel", "ReviewFrame", "Version", "compare_frames", "write_page"]
