"""Long studies over many seeds: `make studies`."""
