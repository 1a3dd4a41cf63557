"""The Designer, the page of `lookdev design`: looks edited live on the turning asset (Burley 2012, section 6.1).

`open_document` opens a job or an asset as a `document`. Its `workspace` has all edits with their `history`, the files
on disk (`sources`), and the `recovery` of unsaved work. `edits` change constants of looks, and `operations` change
their stacks of layers. `edited_job` has the job with its edits, and assigns looks to parts; `looks` finds the files of
looks. `rows` lists layers for the page; `snapshots` and `thumbnails` are pictures. `exact` renders the exact picture,
and `exact_socket` sends it; `turntable` renders turntables; `lights` has the settings of lights.

The page has `panels`. Each panel has a JavaScript module in `static/`, and most have `routes`, which answer its
requests from the state in the `session`. `app` joins all routes in one ASGI application, and `run` serves it.
`lookdev.studio.viewport` draws the picture in the browser.
"""
