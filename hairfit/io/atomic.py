"""Files that are written whole or not at all."""

import contextlib
import errno
import os
import secrets
import shutil
from collections.abc import Iterator
from pathlib import Path

from ..errors import InputError

# What a user can mend: no right to write, no space, a folder where a file should go.
USER_ERRORS = {
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EISDIR,
    errno.ENOTDIR,
    errno.EEXIST,
    errno.ENOTEMPTY,
    errno.ENAMETOOLONG,
}


@contextlib.contextmanager
def atomic_path(path: Path | str) -> Iterator[Path]:
    """Give a temporary name beside `path`, and move it into place on success.

    On any exception, Ctrl-C included, what was written under the temporary name is
    removed and what `path` held before stays. The name keeps the suffix of `path`. It
    serves folders too, where `path` does not exist yet or is an empty folder. Folders
    above `path` are made.

    Args:
        path: Where the file or folder shall be in the end.

    Yields:
        The name to write to.

    Raises:
        InputError: If it cannot be written there.
    """
    path = Path(path)
    token = secrets.token_hex(4)
    new = path.with_name(f".{path.stem}.{token}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield new
        os.replace(new, path)
    except OSError as error:
        if error.errno not in USER_ERRORS:
            raise
        reason = (error.strerror or "it failed").lower()
        raise InputError(
            f"cannot write '{path}': {reason}; choose another place."
        ) from error
    finally:
        if new.is_dir():
            shutil.rmtree(new, ignore_errors=True)
        else:
            new.unlink(missing_ok=True)
