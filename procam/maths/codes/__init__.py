"""Binary and sinusoidal codes, shot marks and dither patterns."""
