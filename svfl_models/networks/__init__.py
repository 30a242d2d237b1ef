"""Encoders, heads and policies, equivariant or ordinary, and their sizes."""
