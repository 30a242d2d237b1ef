"""Export of trained networks, and their predictions for the viewer."""
