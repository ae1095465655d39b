"""Synthetic aperture imaging from a rail: back-projection, range migration, image quality, choice of settings."""
