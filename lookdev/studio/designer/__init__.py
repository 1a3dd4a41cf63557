"""The Designer: looks edited live on the turning asset (Burley 2012, section 6.1).

`opening` makes a `document` of a job or an asset. It holds the contents of files in memory (`sources`), which `edits` of
constants and `operations` on stacks change; a `history` of them, `snapshots`, and a `recovery` of what is unsaved. `rows` is
what the page lists, `thumbnails` are its pictures of presets, `app` has its routes, `run` serves it. The picture is
`lookdev.studio.viewport`'s.
"""
