"""The live page, from Python: a server in a separate process."""

from __future__ import annotations

import atexit
import html
import os
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path
from typing import TYPE_CHECKING

from smpl.support.files import is_shipped, model_path

if TYPE_CHECKING:
    from smpl.model import Model

_running: weakref.WeakSet[Live] = weakref.WeakSet()


class Live:
    """A running server of the live page; ends with `close`, as a context, or with the interpreter.

    Attributes:
        url: address of the page, with the secret that it needs.
    """

    def __init__(self, path: Path, port: int, browser: bool, folder: tempfile.TemporaryDirectory[str] | None) -> None:
        command = [sys.executable, "-m", "smpl.commands.main", "live", str(path), "--port", str(port)]
        if not browser:
            command.append("--no-open")
        self._folder = folder
        # A new session, so that interrupting a cell of a notebook does not end the page.
        with tempfile.TemporaryFile("w+", encoding="utf-8") as errors:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                start_new_session=True,
            )
            assert self._process.stdout is not None
            self.url = self._process.stdout.readline().strip()
            if not self.url:
                self._process.wait()
                errors.seek(0)
                message = errors.read().strip().removeprefix("error: ")
                self.close()
                raise OSError(message or "the server of the live page did not start")
        _running.add(self)

    def close(self) -> None:
        """End the server; a second call does nothing."""
        self._process.terminate()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None
        _running.discard(self)

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        ended = ", ended" if self._process.poll() is not None else ""
        return f"<smpl live page {self.url}{ended}>"

    def _repr_html_(self) -> str:
        url = html.escape(self.url)
        return f'<a href="{url}" target="_blank" rel="noopener">{url}</a>'


def live(path: str | os.PathLike[str] | None = None, *, port: int = 0, browser: bool = True) -> Live:
    """Open the live page: a model with its trajectories while it is written.

    Args:
        path: an `.eq` file, a folder of models, or the name of a shipped model; the working folder
            by default.
        port: port of 127.0.0.1; 0 picks a free one.
        browser: open the browser; else only the address is returned.

    Returns:
        the running server, which ends with `close()` or with the interpreter.

    Raises:
        OSError: no such file, a folder without models, or a port in use.

    Example:
        >>> page = smpl.live("tank.eq", browser=False)      # doctest: +SKIP
        >>> page.url                                        # doctest: +SKIP
        'http://127.0.0.1:40123/.../'
    """
    given = Path.cwd() if path is None else path
    if isinstance(given, str) and is_shipped(given):
        return Live(model_path(given), port, browser, None)
    return Live(Path(given), port, browser, None)


def live_of_model(model: Model, port: int, browser: bool) -> Live:
    """The page on the file of a model; a model without a file gets one in a new folder."""
    path, source = model._arguments["path"], model._arguments["source"]
    if path is not None:
        return live(Path(path), port=port, browser=browser)
    folder = tempfile.TemporaryDirectory(prefix="smpl-live-")
    file = Path(folder.name) / f"{model.name}.eq"
    file.write_text(source, encoding="utf-8")
    return Live(file, port, browser, folder)


@atexit.register
def _close_all() -> None:
    for page in list(_running):
        page.close()
