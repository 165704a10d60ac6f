"""The compiler of all kernels, and the rule by which a compiled one is taken from disk.

Machine code is kept in `__pycache__` beside the source. Its file's name holds a digest of what the
kernel was made of: its instructions and constants, the globals and named tuples that it uses, and
the same of every kernel that it calls. So an edited comment or a copied tree compiles nothing, and
a changed constant compiles every kernel that it reaches, in whatever file. Numba adds the types of
the arguments, the CPU, its own version and Python's.

It knows no wire and no map, so every room may import it.
"""

import builtins
import contextlib
import dis
import functools
import hashlib
import math
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import IO, Any, Generic, ParamSpec, TypeVar, cast, get_args, get_origin, get_type_hints

import numba
import numpy as np
import numpy.typing as npt
from numba.core import caching, types
from numba.core.dispatcher import Dispatcher
from numba.core.runtime import rtsys

Record = Any  # of a structured type: a kernel changes it in place
Records = npt.NDArray[Any]  # of such
P = ParamSpec("P")
R = TypeVar("R")

COMPILED = not numba.config.DISABLE_JIT  # False: kernels run as Python, for coverage
OF_CODE = ("co_code", "co_exceptiontable", "co_names", "co_varnames", "co_freevars", "co_cellvars")
LOAD_GLOBAL = dis.opmap["LOAD_GLOBAL"]
VALUES = (bool, int, float, complex, str, type(None), np.generic, np.dtype)
# no callbacks for C; a kernel goes into its callers whole: to hand over the arrays of a map, some
# hundred words in each call, took a sixth of the time of a scan; divisions are the processor's,
# without a look at the divisor
ASKED = {"no_cfunc_wrapper": True, "forceinline": True, "error_model": "numpy"}
ALLOCATING, RELEASING = set[FunctionType](), set[FunctionType]()


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile with Numba to machine code, kept on disk; strict IEEE arithmetic.

    No fast-math and no threads: the same input gives the same bits. It changes arrays that it is
    given, and makes none: the compiler refuses one that does. So nobody need count who uses an
    array, which took a quarter of the time of a scan. It gives none back either, nor does what it
    calls, for nobody would free that.
    """
    return _compiled(function)


def allocating_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that makes arrays, for itself or to give them back."""
    ALLOCATING.add(cast(FunctionType, function))
    return _compiled(function)


def releasing_kernel(function: Callable[P, R]) -> Callable[P, R]:
    """A kernel that lets other threads run meanwhile: for milliseconds of work beside the loop.

    In the loop itself it would cost more than it gives: who lets go may wait to go on.
    """
    RELEASING.add(cast(FunctionType, function))
    return _compiled(function)


def _compiled(function: Callable[P, R]) -> Callable[P, R]:
    asked = {**ASKED, "nogil": True} if function in RELEASING else ASKED
    compiled = numba.njit(**asked, _nrt=function in ALLOCATING)(function)
    if isinstance(compiled, Dispatcher):  # NUMBA_DISABLE_JIT leaves the function as it is
        compiled.get_call_template = functools.partial(_call_template, compiled.get_call_template)
        compiled._cache = _OnDisk(cast(FunctionType, function))
    return cast(Callable[P, R], compiled)


class Settled(Generic[P, R]):
    """A kernel for one who gives the same types each time: after the first call nobody looks.

    To find out the types of a map's arrays took a tenth of the time of a scan. Other types would be
    taken for those of the first call, so numbers that are given as floats must be so then, too.
    """

    def __init__(self, function: Callable[P, R]) -> None:
        self._function, self._run = function, cast(Callable[P, R] | None, None)

    def __call__(self, *given: P.args, **named: P.kwargs) -> R:
        if self._run is None:
            self._run = self._settle(given)
        return self._run(*given, **named)

    def _settle(self, given: Sequence[Any]) -> Callable[P, R]:
        if not isinstance(self._function, Dispatcher):
            return self._function
        types_of = tuple(numba.typeof(one) for one in given)
        self._function.compile(types_of)  # or taken from disk, or from memory
        return cast(Callable[P, R], self._function.get_overload(types_of))


def records(of: np.dtype[Any], count: int = 1) -> Records:
    """Records (count,) for kernels to change, all zero; of one they get it, or `[0]` of it."""
    return with_fields(np.zeros(count, of))


def fields(of: type[np.generic], names: str) -> list[tuple[str, type[np.generic]]]:
    """Fields of records that are of one type, by their names in a row."""
    return [(name, of) for name in names.split()]


def with_fields(array: Records) -> Records:
    """Records as kernels want them: their fields are attributes, in Python by a `recarray`."""
    return array if COMPILED else array.view(np.recarray)


def _call_template(ask: Callable[..., Any], args: Sequence[Any], kws: dict[str, Any]) -> Any:
    """How one kernel calls another: every number has 64 bits, whatever its value.

    By itself Numba compiles the other once more for a literal 0, a literal 1, a number of 32 bits.
    """
    return ask([_wide(of) for of in args], {name: _wide(of) for name, of in kws.items()})


def _wide(of: Any) -> Any:
    of = types.float64 if of == types.float32 else types.unliteral(of)
    return types.int64 if isinstance(of, types.Integer) and of.bitwidth < 64 else of


@functools.cache
def digest(function: FunctionType) -> str:
    """What a kernel's machine code depends on, as 32 hex digits: the same in every process."""
    whole = hashlib.sha256()
    for part in _parts(function):
        whole.update(f"{part}\n".encode())
    return whole.hexdigest()[:32]


def _parts(function: FunctionType) -> Iterator[str]:
    yield f"{np.__version__} {numba.config.BOUNDSCHECK} {function.__module__}"
    yield f"{ASKED} allocates: {function in ALLOCATING}"
    if function in RELEASING:
        yield "releases"
    codes = list(_codes(function.__code__))
    for code in codes:
        consts = [const for const in code.co_consts if not isinstance(const, CodeType)]
        yield repr([getattr(code, name) for name in OF_CODE])
        yield repr([None if const == function.__doc__ else const for const in consts])
    yield repr((function.__defaults__, function.__kwdefaults__))
    hints = get_type_hints(function)
    if function not in ALLOCATING and _has_array(hints.get("return")):
        raise TypeError(f"{function.__qualname__} gives an array back: it is an allocating kernel")
    yield from (_shape(of) for of in hints.values())
    used = {name for code in codes for name in _globals_of(code)}
    for name in sorted(used - {function.__name__}):
        if name in function.__globals__:
            yield f"{name} {_value(function.__globals__[name], function)}"
        elif not hasattr(builtins, name):
            raise NameError(f"{function.__qualname__} uses {name}, which is nowhere")
    for cell in function.__closure__ or ():
        yield _value(cell.cell_contents, function)


def _codes(code: CodeType) -> Iterator[CodeType]:
    yield code
    for const in code.co_consts:
        if isinstance(const, CodeType):
            yield from _codes(const)


def _globals_of(code: CodeType) -> Iterator[str]:
    """Names that it loads: by `dis` itself it would take ten times as long, at each start."""
    number = 0
    for operation, argument in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        number = number << 8 | argument
        if operation == LOAD_GLOBAL:
            yield code.co_names[number >> 1]  # the lowest bit says something else
        if operation != dis.EXTENDED_ARG:
            number = 0


def _value(value: object, user: FunctionType) -> str:
    if isinstance(value, Dispatcher):
        if user not in ALLOCATING and _has_array(get_type_hints(value.py_func).get("return")):
            raise TypeError(
                f"{user.__qualname__} is given an array by {value.py_func.__qualname__}:"
                " it is an allocating kernel"
            )
        return digest(value.py_func)
    if isinstance(value, tuple):
        return repr([_value(part, user) for part in value])
    if isinstance(value, VALUES):
        return f"{type(value).__name__} {value!r}"
    if value is math or value is np:
        return ""
    if hasattr(value, "_fields"):
        return _shape(value)
    if isinstance(value, ModuleType):  # of which the user names some things
        named = {name for code in _codes(user.__code__) for name in code.co_names}
        found = sorted(named & vars(value).keys())
        return repr([(name, _value(vars(value)[name], user)) for name in found])
    raise TypeError(
        f"{user.__qualname__} uses {value!r}: a kernel may use numbers, tuples of them,"
        " kernels, named tuples, and modules of such"
    )


def _has_array(of: Any) -> bool:
    """Whether a type is that of an array, or has one as its part."""
    parts = get_type_hints(of).values() if hasattr(of, "_fields") else get_args(of)
    return get_origin(of) is np.ndarray or any(_has_array(part) for part in parts)


def _shape(of: Any) -> str:
    """A type in words; a named tuple with its fields, which kernels find by their places."""
    inner = get_type_hints(of) if hasattr(of, "_fields") else dict(enumerate(get_args(of)))
    return f"{of!r} {[(name, _shape(part)) for name, part in inner.items()]}"


class _OnDisk(caching.NullCache):
    """A kernel's machine code on disk, looked for when the kernel is called from Python.

    What Numba does otherwise costs twice the time: it reads the place of each kernel, also of those
    that only other kernels call, and gets the whole compiler ready before it takes code from disk.
    """

    def __init__(self, function: FunctionType) -> None:
        self._function = function

    @functools.cached_property
    def _cache(self) -> caching.FunctionCache:
        before = numba.config.CACHE_LOCATOR_CLASSES
        numba.config.CACHE_LOCATOR_CLASSES = ",".join(f"{__name__}.{place}" for place in PLACES)
        try:
            return _Kept(self._function)
        finally:
            numba.config.CACHE_LOCATOR_CLASSES = before

    @property
    def cache_path(self) -> str:
        return str(self._cache.cache_path)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """The compiled kernel, or None: Numba compiles it, and gets the compiler ready for that."""
        rtsys.initialize(context)  # what machine code itself calls
        return self._cache._load_overload(signature, context)

    def save_overload(self, signature: Any, compiled: Any) -> None:
        """What can't be kept, on a full disk or a system that is read-only, is compiled again."""
        with contextlib.suppress(OSError):
            self._cache.save_overload(signature, compiled)


class _Kept(caching.FunctionCache):
    """Where a kernel's machine code lies, and its files there."""

    def __init__(self, function: FunctionType) -> None:
        super().__init__(function)
        place = self._impl.locator
        self._cache_file = _WholeFiles(
            place.get_cache_path(), self._impl.filename_base, place.get_source_stamp()
        )


class _WholeFiles(caching.IndexDataCacheFile):
    """Files that a power cut leaves whole or not at all. A damaged one is as good as none.

    By itself Numba gives a file its name before its content is on the disk: behind a power cut it
    may be empty, and then no process that needs the kernel comes up again.
    """

    @contextlib.contextmanager
    def _open_for_write(self, path: str) -> Iterator[IO[bytes]]:
        with super()._open_for_write(path) as file:
            yield file
            file.flush()
            os.fsync(file.fileno())

    def _load_index(self) -> dict[Any, str]:
        try:
            return cast(dict[Any, str], super()._load_index())
        except Exception:  # noqa: BLE001  what is damaged may raise any when it is unpickled
            return {}

    def _load_data(self, name: str) -> Any:
        try:
            return super()._load_data(name)
        except Exception as error:
            raise OSError(f"{name} is damaged") from error  # which Numba takes for a missing file


class _ByDigest(caching._CacheLocator):
    """What tells a kernel's machine code from that of an earlier kernel of the same name."""

    def __init__(self, function: FunctionType, file: str) -> None:
        super().__init__(function, file)
        self._digest = digest(function)
        self._name = f"{Path(file).stem}.{function.__qualname__}".replace("<", "").replace(">", "")
        self._is_chosen = False

    def get_source_stamp(self) -> str:
        return self._digest

    def get_disambiguator(self) -> str:
        """Part of the file's name, so that old code is never found under a new index."""
        return self._digest

    def ensure_cache_path(self) -> None:
        """Numba asks when it looks for a place, and again before it saves: then old code goes.

        A place that has the code already need not be writable: on a robot it is not.
        """
        if not self._is_chosen and any(self._digest in path.name for path in self._files()):
            self._is_chosen = True
            return
        super().ensure_cache_path()
        if self._is_chosen:
            for old in self._files():
                if self._digest not in old.name:
                    old.unlink(missing_ok=True)
        self._is_chosen = True

    def _files(self) -> Iterator[Path]:
        return Path(self.get_cache_path()).glob(f"{self._name}-*.nb?")


class Given(_ByDigest, caching.UserProvidedCacheLocator):
    """The folder that NUMBA_CACHE_DIR names."""


class Beside(_ByDigest, caching.InTreeCacheLocator):
    """`__pycache__` beside the source, where that can be written."""


class Home(_ByDigest, caching.UserWideCacheLocator):
    """The user's own cache."""


class Nowhere(Beside):
    """Where none of these can be written: compiled in each process that needs it."""

    def ensure_cache_path(self) -> None:
        """Any place will do, for nothing gets there."""
        if self._is_chosen:
            super().ensure_cache_path()
        self._is_chosen = True


PLACES = ("Given", "Beside", "Home", "Nowhere")
