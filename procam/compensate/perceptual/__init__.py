"""Where subtraction would need negative light: the light that costs the eye least."""
