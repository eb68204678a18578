"""Names that become parts of file names: of cameras, projectors, shots and states of a venue."""

NAME_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
