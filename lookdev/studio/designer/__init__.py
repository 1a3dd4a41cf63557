"""The Designer: looks edited live on the turning asset (Burley 2012, section 6.1).

`document` is what is edited, `app` the routes of the page, `run` serves it. The picture is `lookdev.studio.viewport`'s.
"""
