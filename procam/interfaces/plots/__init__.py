"""Charts and pictures for reports and commands."""
