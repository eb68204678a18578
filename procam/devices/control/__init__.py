"""Remote control of projectors over serial lines: commands are data, one engine sends them."""
