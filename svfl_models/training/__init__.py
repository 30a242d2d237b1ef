"""What every training program uses: the trainer, checkpoints, run folders, progress and augmentation."""
