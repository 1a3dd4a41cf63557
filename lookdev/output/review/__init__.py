"""The review page: a static folder that a browser opens from disk, without a server or a network.

A page from ``file://`` may run scripts and show pictures, but the browser forbids it to `fetch` other files, and to
read a canvas with a picture from another file. So all pixel values are in scripts (`pixels`), and OpenColorIO's view is
a shader (`view`). The code of the page is in ``static``.
"""
