"""Products in the formats of other programs."""
