"""Published models of human vision: uniform luminance, contrast sensitivity and masking."""
