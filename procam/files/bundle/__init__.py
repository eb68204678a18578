"""Bundles: one zip file with a session that can be solved elsewhere, without what is private.

`write` makes one; `read` unpacks one into a new venue folder, and trusts nothing in it.
"""
