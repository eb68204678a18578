"""What people and scripts touch: the command line, the report, the judge."""
