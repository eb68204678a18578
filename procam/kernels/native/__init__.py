"""The compiled library: its sources, how it is found, and the instruction set it runs."""
