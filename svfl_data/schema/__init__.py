"""What an episode is: fields, metadata, clocks and limits; what robots and policies exchange. Imports NumPy only."""
