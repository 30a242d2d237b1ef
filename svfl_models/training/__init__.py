"""The trainer, checkpoints, run folders, progress and augmentation that every training program uses."""
