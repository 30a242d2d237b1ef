"""Specifications of replay buffers: the paper's inputs, or any inputs and any action as recorded."""
