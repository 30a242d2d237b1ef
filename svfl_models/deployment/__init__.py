"""What leaves the training: exported networks, and predictions for the viewer."""
