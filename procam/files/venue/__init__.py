"""venue.toml: tables, checks, messages and manual masks."""
