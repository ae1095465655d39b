"""Polarimetric ray tracing of triangles and materials: Monte Carlo pictures of Stokes vectors and Mueller matrices.

Thesis chapter 4, with any number of bounces. Knows no files and no scene of the rig; ``docs/ray-tracing.md`` tells how
the parts go together.
"""
