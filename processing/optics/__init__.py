"""Optical polarimetry: the camera, the polarizer in front of it, and the Stokes parameters behind it."""
