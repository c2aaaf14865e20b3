"""One source, two speeds: numba's njit where numba is importable, plain Python where it is not."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import sys
from pathlib import Path

from rlcore.core.types import F

HAVE_NUMBA = importlib.util.find_spec("numba") is not None and os.environ.get("RLCORE_NO_NUMBA") != "1"

_lazy = []
_inlined = []


class _Lazy:
    """A function that numba compiles when it is first called, so that importing a module stays quick."""

    def __init__(self, function):
        functools.update_wrapper(self, function)
        self.dispatcher = None
        _lazy.append(self)

    def __call__(self, *args):
        if self.dispatcher is None:
            _link()
        return self.dispatcher(*args)


class _Part(_Lazy):
    """A function that numba compiles into those that call it; from Python its Python body runs."""

    def __call__(self, *args):
        return self.__wrapped__(*args)

    @property
    def _numba_type_(self):
        return self.dispatcher._numba_type_


def _link():
    """Give every waiting function its dispatcher, under the names by which compiled functions call each other."""
    _announce()
    while _inlined:
        _inline(_inlined.pop())
    for lazy in _lazy:
        if lazy.dispatcher is None:
            lazy.dispatcher = _dispatcher(lazy.__wrapped__, isinstance(lazy, _Part))
    for lazy in _lazy:
        names = lazy.__wrapped__.__globals__
        for name, value in names.items():
            if type(value) is _Lazy:
                names[name] = value.dispatcher


def _inline(function):
    from numba import extending

    body = getattr(function, "unchecked", function)
    extending.overload(function, strict=False)(lambda *args, **kwargs: body)


@functools.cache
def _announce():
    """On a terminal, or with RLCORE_NOTES=1, say on stderr why a first call takes seconds; silent in notebooks."""
    if not (sys.stderr.isatty() or os.environ.get("RLCORE_NOTES") == "1"):
        return
    from numba.core import event

    class Note(event.Listener):  # hears of what is compiled, not of what is found on disk
        depth = 0

        def on_start(self, compilation):
            if self.depth == 0:
                name = compilation.data["dispatcher"].__name__
                print(f"rlcore: compiling {name}, once (a few seconds)", file=sys.stderr, flush=True)
            self.depth += 1

        def on_end(self, compilation):
            self.depth -= 1

        def notify(self, compilation):
            if any(lazy.dispatcher is compilation.data["dispatcher"] for lazy in _lazy):
                super().notify(compilation)

    event.register("numba:compile", Note())


def _dispatcher(function, inner):
    """The function, compiled; its machine code is kept on disk where a folder is writable."""
    import numba

    # wrappers: the one for C takes a twelfth of the time of compiling, those for Python a fifth
    dispatcher = numba.njit(
        function, nogil=getattr(function, "alone", False), no_cfunc_wrapper=True, no_cpython_wrapper=inner
    )
    if stamp := _sources():
        try:
            dispatcher.enable_caching()
        except RuntimeError:  # no folder is writable
            return dispatcher
        file = dispatcher._cache._cache_file
        file._source_stamp = file._source_stamp, stamp
    return dispatcher


@functools.cache
def _sources():
    """Digest of the package's sources, "" in a zip: numba does not see that a function in another file has changed."""
    paths = sorted(Path(__file__).parents[1].rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in paths)).hexdigest() if paths else ""


def compiled(function: F) -> F:
    """Compile `function` with numba on first use; leave it alone where there is no numba or RLCORE_NO_NUMBA=1."""
    return _Lazy(function) if HAVE_NUMBA else function  # type: ignore[return-value]


def part(function: F) -> F:
    """As `compiled`, but only compiled functions call the machine code: Python calls the Python body.

    For what takes a generator or a world, which numba takes 1 to 7 us to unpack, and a while to learn to.
    """
    return _Part(function) if HAVE_NUMBA else function  # type: ignore[return-value]


def alone(function: F) -> F:
    """Mark a function that is to be compiled: other threads run meanwhile, such as the one that hears Ctrl-C."""
    function.alone = True  # type: ignore[attr-defined]
    return function


def inlined(function: F) -> F:
    """A plain function outside, part of the machine code inside compiled functions that call it, unchecked there."""
    if HAVE_NUMBA:
        _inlined.append(function)
    return function
