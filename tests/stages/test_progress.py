"""Progress that shows nothing."""

from expdesign.stages.stage import Progress


def test_progress_that_shows_nothing():
    progress = Progress()
    with progress.search(None) as report, progress.count("repetitions") as advanced:
        report(None)
        advanced(1, 2)
