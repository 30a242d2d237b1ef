"""What touches the operating system, the terminal and files of strangers, for all three packages."""
