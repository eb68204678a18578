"""`procam venue`: what was done at a venue, and its calibrations."""
