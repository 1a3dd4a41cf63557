"""The review page of `lookdev review`: a static folder that a browser opens from disk, without a server or a network.

`folder` reads the frames of output folders, and `page` writes the folder of the page. A page from ``file://`` may run
scripts and show pictures, but the browser forbids it to `fetch` other files, and to read the pixels of a picture in
another file. So the page gets all pixel values from scripts (`pixels`), and shows them by OpenColorIO's view as a
shader (`view`). The code of the page is in ``static``.
"""
