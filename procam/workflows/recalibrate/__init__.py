"""Some projectors measured again: which, what one solves to, and whether the venue is worse for it."""
