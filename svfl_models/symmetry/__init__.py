"""Groups, representations and equivariant layers, and the test that a network is equivariant."""
