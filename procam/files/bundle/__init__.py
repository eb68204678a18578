"""Bundles: one zip file with a session that can be solved elsewhere, without what is private.

`write_bundle` makes one, `writing_bundle` with its progress; `open_bundle` unpacks one into a new venue
folder, and trusts nothing in it; `read_manifest` only says what is in one.
"""

from procam.files.bundle.read import open_bundle, read_manifest
from procam.files.bundle.write import write_bundle, writing_bundle

__all__ = ["open_bundle", "read_manifest", "write_bundle", "writing_bundle"]
