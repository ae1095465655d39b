"""Pure numerics on NumPy arrays: no files, no devices, no threads, no windows."""
