"""From the description of a scene to the parts of its program: sizes, places, sides, time steps, limits."""
