"""Pictures in, pictures and projector frames out: the hot path."""
