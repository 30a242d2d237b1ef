"""Experiment trackers that a training can be logged to: TensorBoard, Weights & Biases, MLflow."""
