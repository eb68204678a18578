"""Arrays in, arrays out: geometry, codes, curves and light, without files, devices or state."""
