"""Calibration targets, calibration constants and polarimetric imbalance."""
