"""Commands that write a new dataset from recorded ones, which stay as they are; one module each."""
