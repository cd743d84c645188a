import pytest

from estimation.channels.check import ChannelCheck


@pytest.fixture
def known_channels(monkeypatch):
    """Leave out the check of the channels: up to a third of an estimate, and no number of it."""
    unchecked = ChannelCheck((), {}, sure=False, explained=0.0, unchecked="they are known")
    check = "estimation.identification.recording.check_channels"
    monkeypatch.setattr(check, lambda *_, **__: unchecked)
