"""Images in every form that procam reads and writes.

`pixels` is the base, on OpenImageIO; `layers` (maps), `stills` (content) and `photos` build on it;
`sequences` are numbered files; `movies` and `slideshow` are for moving pictures.
"""
