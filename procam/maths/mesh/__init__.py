"""Screens that are triangle meshes: ray casting, form factors, radiosity and light within limits.

`raycast` and `shape` serve the bundle adjustment, `form_factors`, `radiosity` and `active_set` light.
"""
