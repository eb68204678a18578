"""Errors of the operating system in plain sentences."""

import errno

IN_THE_WAY = "a file is where a folder must be; choose another name or move the file away"
WORDS = {
    errno.EEXIST: IN_THE_WAY,
    errno.ENOTDIR: IN_THE_WAY,
    errno.EISDIR: "this is a folder, and a file is needed; choose another name",
    errno.ELOOP: "this is a link, and procam writes only files of its own here; remove the link",
    errno.ENOENT: "there is no such file or folder; is its name right?",
    errno.EACCES: "there is no permission to read or write here; choose another place, or change its "
    "permissions",
    errno.EROFS: "this disk is read-only; choose another place",
    errno.ENOSPC: "the disk is full; free some space and run the command again",
    errno.EDQUOT: "the disk quota is used up; free some space and run the command again",
    errno.EFBIG: "the file may not grow that large here; choose another disk, or raise the limit (ulimit -f)",
    errno.ENAMETOOLONG: "this name is too long for the disk; choose a shorter one",
}


def worded(error: OSError) -> str:
    """One line: the file, what is wrong, what to do.

    >>> worded(NotADirectoryError(errno.ENOTDIR, "Not a directory", "notes.txt/out"))[:50]
    'notes.txt/out: a file is where a folder must be; c'
    """
    if error.errno is None:
        return str(error)
    # the second is the new name of a renamed file
    where = error.filename2 or error.filename or "disk"
    other = f"the system refuses to read or write ({error.strerror}); check the disk"
    return f"{where}: {WORDS.get(error.errno, other)}"
