"""The `procam` command."""
