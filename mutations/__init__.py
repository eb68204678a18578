"""Small mistakes made on purpose in procam, to see whether the tests notice them."""
