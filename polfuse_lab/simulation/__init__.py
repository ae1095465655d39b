"""Scenes of bodies from a file in both eyes: a focused quad-polarized picture and polarized light, on one grid."""
