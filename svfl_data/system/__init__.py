"""Access to the operating system, the terminal and untrusted files, shared by the three packages."""
