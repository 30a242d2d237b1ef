"""What every training program uses: trainer, hardware, trackers, checkpoints, run folders, progress, augmentation."""
