"""Reading and writing files.

`images/` has pixels, maps, pictures, photographs and movies, `venue/` the venue.toml; `session` stores
captures and `calibration` results. All write through `atomic`, so that a kill loses nothing.
"""
