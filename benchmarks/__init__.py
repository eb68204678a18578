"""Speed as ratios, peers and floor interleaved in one process: `make bench`."""
