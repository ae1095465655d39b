"""SAR and camera together: registration, fused features, classes, separability, anomalies."""
