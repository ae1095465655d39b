"""From a session to calibrated, polarimetric, optical and fused products, and the pictures of them."""
