import pytest

from svfl_models.centering import report, train


@pytest.fixture
def drawn(monkeypatch, samples):
    """Samples from memory, and no pictures of the training, which take longer than it."""
    monkeypatch.setattr(train, "_load", lambda *_: samples)
    monkeypatch.setattr(train, "with_camera", lambda config: config)
    for name in ("plot_curves", "plot_confusion"):
        monkeypatch.setattr(report, name, lambda *arguments: None)
