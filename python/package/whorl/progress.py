"""Progress of long calls."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import Any, Callable, Iterator, Optional, Union

Progress = Union[bool, None, Callable[[float, str], object]]
"""True: a bar (tqdm, if it is installed, else lines on the error stream). A function: called with the share done (0 to 1) and
the current step. None or False: nothing. What the function raises ends the computation."""


@contextmanager
def reporting(progress: Progress, what: str) -> Iterator[Optional[Callable[[float, str], Any]]]:
    """The function that the native part calls."""
    if progress is None or progress is False:
        yield None
    elif progress is not True:
        if not callable(progress):
            raise TypeError(f"progress is {progress!r}; allowed: True, None or a function of share and step")
        yield progress
    else:
        try:
            from tqdm.auto import tqdm
        except ImportError:
            yield _lines(what)
            return
        form = "{l_bar}{bar}| {elapsed}<{remaining}{postfix}"
        with tqdm(total=1.0, desc=what, bar_format=form, leave=False) as bar:

            def show(share: float, doing: str) -> None:
                bar.set_postfix_str(doing, refresh=False)
                # tqdm counts up; a step that begins anew keeps the bar where it is.
                bar.update(max(0.0, share - bar.n))

            yield show


def _lines(what: str) -> Callable[[float, str], None]:
    last = ""

    def show(share: float, doing: str) -> None:
        nonlocal last
        if doing != last:
            last = doing
            print(f"{what}: {100 * share:3.0f} %  {doing}", file=sys.stderr)

    return show
