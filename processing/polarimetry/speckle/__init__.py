"""Speckle: its simulation, its measures, and filters of coherency and covariance matrices."""
