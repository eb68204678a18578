"""Everything that touches the disk: images, venues, sessions, calibrations."""
