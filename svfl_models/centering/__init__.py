"""Block centering: data, classifier, training, evaluation and report."""
