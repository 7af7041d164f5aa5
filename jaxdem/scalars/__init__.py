"""Temperature and other scalars: what the fluid carries, what grains and fluid exchange, what contacts conduct.

The velocity of the fluid and the places of the grains are those of the interval; scalars follow them. What acts back is
the buoyancy of warm fluid, through its acceleration on the faces.
"""
