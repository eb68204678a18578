"""`procam session`: a capture session step by step, driven or by hand."""
