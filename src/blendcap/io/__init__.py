"""Files: one module per format; imports data only."""
