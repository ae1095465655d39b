"""What moves: in the radar's picture (thesis chapter 8) and between the exposures of a turning polarizer."""
