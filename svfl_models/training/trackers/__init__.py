"""Experiment trackers that a training can be logged to beside its metrics file: TensorBoard, Weights & Biases, MLflow."""
