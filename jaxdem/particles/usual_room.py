"""What a neighbour list usually needs room for, and the margins."""

EXTRA_CAPACITY = 1.25
"""Slots are allocated for this multiple of the largest number of neighbours found."""

USUAL_SLOTS = {2: 8, 3: 16}
"""Slots allocated at least, by dimension: what a dense pack of equal spheres needs once it has formed."""

USUAL_PAIRS = {2: 3.25, 3: 5.0}
"""Pairs allocated at least for each particle, by dimension: three in a hexagonal layer, and a margin."""

EXTRA_PAIRS = 1.1
"""Pairs are allocated for this multiple of those found: their sum varies less than the most that one particle has."""

DENSE = {2: 0.85, 3: 0.64}
"""Solid fraction of a dense pack, by dimension."""
