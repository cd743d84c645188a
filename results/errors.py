"""What is wrong with a run folder that results are to be made from."""

from __future__ import annotations

from pathlib import Path


class RunFolderError(Exception):
    """A file of a run folder is missing or does not hold what it should.

    Parameters
    ----------
    path : Path
        The file, or the folder itself.
    message : str
        What is wrong with it.

    Attributes
    ----------
    path : Path
    message : str
    """

    def __init__(self, path: Path, message: str) -> None:
        super().__init__(f"{path}: {message}")
        self.path = path
        self.message = message

    def __reduce__(self) -> tuple[type[RunFolderError], tuple[Path, str]]:
        return type(self), (self.path, self.message)


class MissingFileError(RunFolderError):
    """A file that the results are made from is not in the run folder.

    Parameters
    ----------
    path : Path
        The file.
    message : str, optional
        What is wrong, and how the file is made.
    """

    def __init__(
        self, path: Path, message: str = "missing; `expdesign design` writes this file"
    ) -> None:
        super().__init__(path, message)
