"""The Designer: looks edited live on the turning asset (Burley 2012, section 6.1).

`opening` makes a `document` of a job or an asset. The contents of files that it edits are in a `workspace`: a `history`
of them, which `edits` of constants and `operations` on stacks change; what is on disk (`sources`); and the `recovery`
of what is unsaved. `rows` is what the page lists; `snapshots` and `thumbnails` are its pictures. `app` has the routes
of the page, and `run` serves it. The picture is `lookdev.studio.viewport`'s.
"""
