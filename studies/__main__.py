"""Run every study and write its results beside it (JSON and a table)."""

import sys

from studies import seeds

if __name__ == "__main__":
    sys.exit(seeds.main())
