"""The review page: a static folder that a browser opens from disk, without a server or a network.

A page from ``file://`` may run scripts and show pictures, but it may not read other files: `fetch` is forbidden, and so
is reading a canvas with a picture from another file. Therefore all pixel values are in scripts (`pixels`), and
OpenColorIO's view is a shader (`view`). The code of the page is in ``static``.
"""
