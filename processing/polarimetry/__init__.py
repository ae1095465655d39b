"""Scattering matrices in polarimetric bases: Pauli and lexicographic vectors, canonical targets."""
