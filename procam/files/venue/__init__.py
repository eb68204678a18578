"""venue.toml, the description of a rig by its owner.

`load.load_venue` reads it: `tables` has keys and bounds, `messages` explains pydantic's findings, `checks`
and `server_checks` find contradictions; `masks` turns its `outlines` into pixels.
"""
