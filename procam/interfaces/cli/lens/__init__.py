"""`procam lens`: a camera, or a projector, measured on a desk."""
