"""The desktop program: shows and asks, computes nothing."""
