"""Exported programs (``.pt2``): read and run without unpickling anything."""
