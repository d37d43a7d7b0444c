"""Object code for the kernels that Python calls, and only for these.

Numba makes object code for every kernel, optimizes it for itself and once more within each caller,
and caches it. Most kernels of the library are called by other kernels alone. The dispatcher of this
module keeps the unoptimized code of such an inner kernel in memory, and the kernel that Python
calls, the entry, is optimized, emitted and cached with all inner kernels in it. An inner kernel
that Python calls as well becomes an entry at that call. The arithmetic is the same, since LLVM does
not reorder it.

The module relies on parts of Numba without a documented interface. Its import fails with an
ImportError where these differ, and `cislunar.compiled` then uses Numba's own dispatcher.
"""

import logging
import pickle
import threading
from collections.abc import Callable
from functools import cache
from inspect import unwrap
from typing import Any

from numba.core import codegen, compiler, config, dispatcher, typed_passes
from numba.core.caching import FunctionCache, NullCache
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature

_ENVIRONMENT = "_ZN08NumbaEnv"
"""Beginning of the names of the variables that point to the environments of kernels."""

_USED_NAMES = {
    codegen.CPUCodeLibrary.__init__: ("_linking_libraries", "_final_module"),
    codegen.CPUCodeLibrary.finalize: (
        "_raise_if_finalized", "_linking_libraries", "_reload_init", "link_in",
        "_get_module_for_linking", "_optimize_final_module", "_finalize_final_module",
    ),
    codegen.CPUCodeLibrary._finalize_final_module: ("_finalize_dynamic_globals", "_finalized"),
    codegen.CPUCodeLibrary.add_linking_library: ("_ensure_finalized",),
    codegen.JITCPUCodegen.set_env: ("get_global_value_address",),
    compiler.CompilerBase.__init__: ("library", "flags", "state"),
    compiler.CompilerBase.compile_extra: ("state", "_compile_bytecode"),
    compiler.CompileResult._find_referenced_environments: ("_final_module", "lookup_environment"),
    typed_passes.BaseNativeLowering.run_pass: (
        "library", "no_cpython_wrapper", "no_cfunc_wrapper", "no_compile", "get_executable",
    ),
    dispatcher._FunctionCompiler._compile_core: ("Flags", "compile_extra", "pipeline_class"),
    dispatcher._DispatcherBase.get_call_template: ("compile", "nopython_signatures"),
    dispatcher._DispatcherBase.get_overload: ("overloads", "entry_point"),
    dispatcher._DispatcherBase.add_overload: ("_insert", "overloads", "entry_point"),
    dispatcher.Dispatcher.compile: (
        "overloads", "_cache", "load_overload", "_compiler", "add_overload", "save_overload",
    ),
}  # fmt: skip
"""Functions of Numba that this module overrides or relies on, and names that they must use."""


def _require_known_numba() -> None:
    """Raise an ImportError if a function of Numba does not use the names of `_USED_NAMES`."""
    for function, names in _USED_NAMES.items():
        code = unwrap(function).__code__
        missing = {*names} - {*code.co_names, *code.co_varnames, *code.co_freevars}
        if missing:
            raise ImportError(f"numba: {function.__qualname__} without {', '.join(missing)}")
    for name in ("no_compile", "no_cpython_wrapper", "no_cfunc_wrapper"):
        if not hasattr(compiler.Flags, name):
            raise ImportError(f"numba: no flag {name}")
    if not {"entry_point", "referenced_envs"} <= {*compiler.CR_FIELDS}:
        raise ImportError("numba: other results of compilation")


_require_known_numba()


@cache
def _warn_once(text: str) -> None:
    """Log a line, once in a process."""
    logging.getLogger("cislunar").warning(text)


class _Active(threading.local):
    """What this thread compiles."""

    within_entry = False
    """Whether an entry of the library is being compiled."""
    called_within = False
    """Whether the compilation that begins now is that of a call within an entry."""


_ACTIVE = _Active()


class _InnerLibrary(codegen.JITCodeLibrary):
    """Code of an inner kernel and of all that it calls, not optimized, and without object code."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalize_dynamic_globals()
        self._finalized = True


class _InnerCompiler(compiler.Compiler):
    """Compiles a kernel to an `_InnerLibrary`, without the functions by which Python calls it."""

    def compile_extra(self, function: Callable) -> Any:
        flags = self.state.flags
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        generator = self.state.targetctx.codegen()
        self.state.library = _InnerLibrary(generator, function.__qualname__)
        return super().compile_extra(function)


class _KernelCache(FunctionCache):
    """A cache on disk that a run does not depend on: where it fails, kernels are compiled."""

    def load_overload(self, signature: Any, target: Any) -> Any:
        try:
            found = super().load_overload(signature, target)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            self._give_up("read", error)
            return None
        if found is None and self._enabled:
            self._tell_of_other_processors(signature, target.codegen())
        return found

    def save_overload(self, signature: Any, result: Any) -> None:
        try:
            super().save_overload(signature, result)
        except OSError as error:
            self._give_up("written", error)

    def _give_up(self, done: str, error: Exception) -> None:
        reason = getattr(error, "strerror", None) or type(error).__name__
        _warn_once(
            f"cached kernels cannot be {done} ({reason}: {self.cache_path}); kernels are compiled "
            "in every process; NUMBA_CACHE_DIR selects another folder"
        )
        self.disable()

    def _tell_of_other_processors(self, signature: Any, generator: Any) -> None:
        key = self._index_key(signature, generator)
        try:
            cached = self._cache_file._load_index()
        except (OSError, EOFError, pickle.UnpicklingError):
            return
        others = {each[1][1] for each in cached if each != key and each[::2] == key[::2]}
        if others:
            _warn_once(
                f"kernels are cached for another processor ({', '.join(sorted(others))}) and are "
                f"compiled for this one ({key[1][1]})"
            )


class KernelDispatcher(CPUDispatcher):
    """Dispatcher of a kernel that makes object code only if Python calls the kernel."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._inner: list[Any] = []
        """Results of compilation as an inner kernel. Entries refer to their environments."""

    def enable_caching(self) -> None:
        try:
            self._cache = _KernelCache(self.py_func)
        except RuntimeError:  # no folder can be written
            _warn_once(
                "no folder for cached kernels can be written; kernels are compiled in every "
                "process; NUMBA_CACHE_DIR selects a folder"
            )
            return
        if config.CACHE_DIR and not self._cache.cache_path.startswith(config.CACHE_DIR):
            _warn_once(
                f"the folder NUMBA_CACHE_DIR={config.CACHE_DIR} cannot be written; kernels are "
                "cached in the folders of the library or of the user"
            )

    def get_call_template(self, args: Any, kws: Any) -> Any:
        # a kernel with parallel loops calls object code of its own
        parallel = self.targetoptions.get("parallel", False)
        _ACTIVE.called_within = _ACTIVE.within_entry and not parallel
        try:
            return super().get_call_template(args, kws)
        finally:
            _ACTIVE.called_within = False

    def compile(self, sig: Any) -> Any:
        called_within, _ACTIVE.called_within = _ACTIVE.called_within, False
        with global_compiler_lock:
            if called_within:
                return self._compile_inner(sig)
            args = tuple(normalize_signature(sig)[0])
            if any(self.overloads.get(args) is each for each in self._inner):
                del self.overloads[args]
            before, _ACTIVE.within_entry = _ACTIVE.within_entry, True
            try:
                return super().compile(sig)
            finally:
                _ACTIVE.within_entry = before

    def _compile_inner(self, sig: Any) -> Any:
        usual = self._cache, self._compiler.pipeline_class
        self._cache, self._compiler.pipeline_class = NullCache(), _InnerCompiler
        try:
            return super().compile(sig)
        finally:
            self._cache, self._compiler.pipeline_class = usual

    def add_overload(self, cres: Any) -> None:
        if cres.entry_point is None:
            # callers find the code of an inner kernel by an object in place of its function
            cres = cres._replace(entry_point=object())
            self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
            self._inner.append(cres)
            self.overloads[tuple(cres.signature.args)] = cres
            return
        if cres.referenced_envs is None:  # not from the cache, which sets them
            cres = cres._replace(referenced_envs=tuple(_set_environments(cres.library)))
        super().add_overload(cres)


def _set_environments(library: Any) -> list[Any]:
    """Set the pointers to the environments of the inner kernels of an entry, which it returns."""
    found = []
    for variable in library._final_module.global_variables:
        if variable.name.startswith(_ENVIRONMENT):
            environment = lookup_environment(variable.name)
            if environment is not None:
                library.codegen.set_env(variable.name, environment)
                found.append(environment)
    return found
