"""What the operating system refuses, in the words of procam's own errors."""

import errno

IN_THE_WAY = "got a file where a folder must be, expected a folder; choose another name or move the file away"
WORDS = {
    errno.EEXIST: IN_THE_WAY,
    errno.ENOTDIR: IN_THE_WAY,
    errno.EISDIR: "got a folder, expected a file; choose another name",
    errno.ENOENT: "got no such file or folder, expected one; is its name right?",
    errno.EACCES: "got no permission, expected to read or write there; choose another place, or change "
    "its permissions",
    errno.EROFS: "got a disk that is read only, expected to write there; choose another place",
    errno.ENOSPC: "got a full disk, expected room; make some and run it again",
    errno.EDQUOT: "got a disk quota that is used up, expected room; make some and run it again",
    errno.ENAMETOOLONG: "got a name that is too long for the disk, expected a shorter one",
}


def worded(error: OSError) -> str:
    """One line: what, got, expected, what to try.

    >>> worded(NotADirectoryError(errno.ENOTDIR, "Not a directory", "notes.txt/out"))[:50]
    'notes.txt/out: got a file where a folder must be, '
    """
    if error.errno is None:
        return str(error)
    where = error.filename2 or error.filename or "disk"  # the second is what a file is renamed to
    other = (
        f"got the system's error {error.strerror!r}, expected to read or write; is the disk well?"
    )
    return f"{where}: {WORDS.get(error.errno, other)}"
