"""Names of the axes, in columns, keys and messages."""

AXES = {2: "xz", 3: "xyz"}
"""By dimension; the last one is up."""
